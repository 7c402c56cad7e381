"""SVG panels drawn with matplotlib, ready to stand inline in an HTML page.

Lines and text are drawn in the page's own colour (`currentColor`), so one panel serves light and dark pages.
Same input, same bytes. matplotlib's object-oriented interface only; no global state is left changed.
"""

import io
import math
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, cast

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from space_envs.errors import ConfigurationError

INK = "#010203"  # stands for the page's colour until the SVG is written
WIDTH = 4.4  # inches of one panel: 317 CSS points, so that text keeps its size on a phone
LONE = 5.0  # inches of a panel that stands alone, legible on a phone and not too large on a screen

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
    # Far from the point; a thin line leads there.
    *(
        (
            reach * across,
            reach * up,
            ("right", "center", "left")[across + 1],
            ("top", "center", "bottom")[up + 1],
        )
        for reach in (26, 42, 58)
        for across, up in ((1, -1), (-1, -1), (0, -1), (1, 1), (-1, 1), (0, 1))
    ),
)
_LED = 25  # points from which on a label needs the line


@dataclass(frozen=True)
class Panel:
    """One SVG with the sentence that stands for it where it cannot be seen."""

    svg: str
    alt: str
    key: str = ""
    figure: Figure | None = field(default=None, compare=False, repr=False)  # that it was written from

    def standalone_svg(self) -> str:
        """The SVG as a file of its own, with its size and black lines on white."""
        (width, height), svg = self._inches(), self.svg.replace("currentColor", "#000000")
        size = f' width="{width:g}in" height="{height:g}in" style="background:#ffffff"'
        return '<?xml version="1.0" encoding="utf-8"?>\n' + svg.replace("<svg", f"<svg{size}", 1) + "\n"

    def png(self, dpi: int = 150) -> bytes:
        """The panel as a PNG, on white.

        Raises:
            ConfigurationError: for a panel that was not drawn by `draw_panel`.
        """
        if self.figure is None:
            raise ConfigurationError(f"panel {self.key!r} has no figure to make a PNG from")
        content = io.BytesIO()
        with _settings(self.key):
            self.figure.set_layout_engine("none")  # as it was laid out for the SVG
            self.figure.savefig(
                content,
                format="png",
                dpi=dpi,
                facecolor="white",
                transparent=False,
                metadata={"Software": None},
            )
        return content.getvalue()

    def _inches(self) -> tuple[float, float]:
        box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', self.svg)
        return (float(box[1]) / 72, float(box[2]) / 72) if box else (WIDTH, 3.0)


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
            if math.hypot(*best[1].xyann) > _LED:
                axes.annotate(
                    "",
                    (x, y),
                    best[1].xyann,
                    textcoords="offset points",
                    arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.6, "alpha": 0.5, "shrinkA": 0},
                )


def draw_panel(
    key: str,
    draw: Callable[..., None],
    alt: str,
    width: float = WIDTH,
    height: float = 3.0,
    whole: bool = False,
) -> Panel:
    """Draw one panel; `draw` gets the axes, or the whole figure."""
    with _settings(key):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure if whole else figure.subplots())
        text = io.StringIO()
        figure.savefig(
            text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
        )
    return Panel(_inline(text.getvalue(), key), alt, key, figure)


@contextmanager
def _settings(key: str) -> Iterator[None]:
    """A user's matplotlibrc must not change the report, nor the report the user's settings."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        # The text stays text: the browser has the letters that matplotlib's own font lacks.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        defaults = matplotlib.rcParamsDefault
        matplotlib.rcParams.update({name: defaults[name] for name in defaults if name not in _EXCLUDED})
        matplotlib.rcParams.update(_style(key))
        yield


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
    # A hundredth of a point is finer than any screen, and a third of the size.
    svg = re.sub(r' d="[^"]*"', lambda path: re.sub(r"-?\d+\.\d{3,}", _hundredths, path[0]), svg)
    svg = _with_prefix(svg, key)
    # The page sizes it; the view box keeps the proportions.
    return re.sub(
        r'^<svg([^>]*?) width="[^"]*"', r"<svg\1", re.sub(r'^<svg([^>]*?) height="[^"]*"', r"<svg\1", svg)
    )


def _hundredths(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


def prefixed(panel: Panel, prefix: str) -> Panel:
    """The panel with other ids, for a page that shows the same figure of several tasks."""
    return replace(panel, svg=_with_prefix(panel.svg, prefix))


def _with_prefix(svg: str, prefix: str) -> str:
    svg = re.sub(r'\bid="', f'id="{prefix}-', svg)
    return re.sub(r'((?:xlink:)?href="#|url\(#)', rf"\g<1>{prefix}-", svg)
