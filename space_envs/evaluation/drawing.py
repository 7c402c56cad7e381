"""SVG panels drawn with matplotlib, ready to stand inline in an HTML page.

Lines and text are drawn in the page's own colour (`currentColor`), so one panel serves light and dark pages.
Same input, same bytes. matplotlib's object-oriented interface only; no global state is left changed.
"""

import io
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

INK = "#010203"  # stands for the page's colour until the SVG is written
WIDTH = 4.4  # inches of one panel: 317 CSS points, so that text keeps its size on a phone

_EXCLUDED = {"backend", "backend_fallback", "interactive", "toolbar", "timezone", "webagg.port"}


# Where a label may stand: offset to the right and up in points, horizontal and vertical alignment.
_PLACES = (
    (0, 10, "center", "bottom"),
    (10, 0, "left", "center"),
    (-10, 0, "right", "center"),
    (0, -10, "center", "top"),
    (8, 8, "left", "bottom"),
    (-8, 8, "right", "bottom"),
    (8, -8, "left", "top"),
    (-8, -8, "right", "top"),
    (0, 22, "center", "bottom"),
    (0, -22, "center", "top"),
    (14, 14, "left", "bottom"),
    (14, -14, "left", "top"),
)


@dataclass(frozen=True)
class Panel:
    """One SVG with the sentence that stands for it where it cannot be seen."""

    svg: str
    alt: str


def label_points(axes: Axes, labels: Sequence[tuple[str, float, float]]) -> None:
    """Write each (text, x, y) beside its point, where it covers the fewest other points and labels.

    Call it last: it lays the figure out to know where things are.
    """
    figure = cast(Figure, axes.get_figure(root=True))
    figure.draw_without_rendering()
    centres = axes.transData.transform([(x, y) for _, x, y in labels])
    reach = figure.dpi / 9  # half the size of a marker, in pixels
    taken = [Bbox.from_extents(*(centre - reach), *(centre + reach)) for centre in centres]
    frame = axes.get_window_extent()
    for text, x, y in labels:
        best: tuple[int, Annotation, Bbox] | None = None
        for right, up, across, along in _PLACES:
            note = axes.annotate(text, (x, y), (right, up), textcoords="offset points", ha=across, va=along)
            box = note.get_window_extent()
            outside = not (
                frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            )
            covered = box.count_overlaps(taken) + outside
            if best is None or covered < best[0]:
                if best:
                    best[1].remove()
                best = (covered, note, box)
            else:
                note.remove()
            if not covered:
                break
        if best:
            taken.append(best[2])


def draw_panel(
    key: str,
    draw: Callable[..., None],
    alt: str,
    width: float = WIDTH,
    height: float = 3.0,
    whole: bool = False,
) -> Panel:
    """Draw one panel; `draw` gets the axes, or the whole figure."""
    # A user's matplotlibrc must not change the report, nor the report the user's settings.
    with matplotlib.rc_context(), warnings.catch_warnings():
        # The text stays text: the browser has the letters that matplotlib's own font lacks.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        defaults = matplotlib.rcParamsDefault
        matplotlib.rcParams.update({name: defaults[name] for name in defaults if name not in _EXCLUDED})
        matplotlib.rcParams.update(_style(key))
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure if whole else figure.subplots())
        text = io.StringIO()
        figure.savefig(
            text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
        )
    return Panel(_inline(text.getvalue(), key), alt)


def _style(key: str) -> dict[Any, Any]:
    return {
        "svg.hashsalt": key,
        "svg.fonttype": "none",
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "savefig.transparent": True,
        "text.color": INK,
        "axes.edgecolor": INK,
        "axes.labelcolor": INK,
        "axes.titlesize": 11,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.7,
        "axes.axisbelow": True,
        "xtick.color": INK,
        "ytick.color": INK,
        "grid.color": INK,
        "grid.alpha": 0.14,
        "grid.linewidth": 0.7,
        "hatch.linewidth": 0.6,
        "font.size": 10,
        "legend.frameon": False,
        "legend.fontsize": 9,
        "legend.handlelength": 1.6,
        "legend.columnspacing": 1.2,
        "lines.solid_capstyle": "round",
    }


def _inline(svg: str, key: str) -> str:
    """The svg element alone, in the page's colour, its ids told apart by the key."""
    svg = svg[svg.index("<svg") :].replace(INK, "currentColor")
    svg = _with_prefix(svg, key)
    # The page sizes it; the view box keeps the proportions.
    return re.sub(
        r'^<svg([^>]*?) width="[^"]*"', r"<svg\1", re.sub(r'^<svg([^>]*?) height="[^"]*"', r"<svg\1", svg)
    )


def prefixed(panel: Panel, prefix: str) -> Panel:
    """The panel with other ids, for a page that shows the same figure of several tasks."""
    return replace(panel, svg=_with_prefix(panel.svg, prefix))


def _with_prefix(svg: str, prefix: str) -> str:
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    return re.sub(r'((?:xlink:)?href="#|url\(#)', rf"\g<1>{prefix}-", svg)
