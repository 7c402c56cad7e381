"""Panels: SVG drawn with matplotlib, ready to stand inline in an HTML page.

Lines and text are drawn in the page's own color (`currentColor`), so one panel serves light and dark pages.
The same input gives the same bytes. Only matplotlib's object-oriented interface is used; no global state is
left changed.
"""

import io
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from space_envs.errors import ConfigurationError

INK = "#010203"  # stands for the page's color until the SVG is written
WIDTH = 4.4  # inches of one panel: 317 CSS points, so that text keeps its size on a phone
LONE = 5.0  # inches of a panel that stands alone, legible on a phone and not too large on a screen
_EXCLUDED = {"backend", "backend_fallback", "interactive", "toolbar", "timezone", "webagg.port"}


@dataclass(frozen=True)
class Panel:
    """An SVG with its alternative text."""

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
    """Context of the report's own matplotlib settings, apart from the user's."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        # The text stays text: the browser has the characters that matplotlib's own font lacks.
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
    """The svg element alone, in the page's color, its ids told apart by the key."""
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
