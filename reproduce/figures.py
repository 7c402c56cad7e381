"""Figures of a page: panels that stand inline, and the same panels side by side in a file of their own."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure as MatplotlibFigure

from space_envs.evaluation.drawing import WIDTH, Panel, draw_panel

Draw = Callable[[Axes], None]

# A file that is looked at by itself brings its own paper, light or dark as its reader's system is.
PAPER = """<style>
svg { color: #1b2130; background: #ffffff; font-family: system-ui, sans-serif; }
.paper { fill: #ffffff; }
@media (prefers-color-scheme: dark) {
  svg { color: #e6e9f0; background: #141b2b; }
  .paper { fill: #141b2b; }
}
</style><rect class="paper" x="-9999" y="-9999" width="19998" height="19998"/>"""


@dataclass(frozen=True)
class Sketch:
    """A panel before it is drawn: what draws it into axes, and the sentence that stands for it."""

    draw: Draw
    alt: str


@dataclass(frozen=True)
class Figure:
    """A figure of the page.

    Attributes:
        key: of its ids and of its file. panels: for the page. file: the same as one SVG file.
    """

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    file: str

    @property
    def alt(self) -> str:
        """The sentences of all panels."""
        return " ".join(panel.alt for panel in self.panels)


def figure(
    key: str, title: str, caption: str, sketches: Sequence[Sketch], columns: int = 3, height: float = 2.7
) -> Figure:
    """Draw the panels one by one, and all of them together in rows of `columns`; `height` in inches."""
    width = WIDTH if len(sketches) > 1 else 1.5 * WIDTH
    panels = tuple(
        draw_panel(f"{key}-{number}", sketch.draw, sketch.alt, width=width, height=height)
        for number, sketch in enumerate(sketches)
    )
    across = min(columns, len(sketches))
    down = -(-len(sketches) // across)

    def together(sheet: MatplotlibFigure) -> None:
        grid = sheet.subplots(down, across, squeeze=False).ravel()
        for axes, sketch in zip(grid, sketches, strict=False):
            sketch.draw(axes)
        for axes in grid[len(sketches) :]:
            axes.remove()

    sheet = draw_panel(
        key, together, "", width=max(3.9 * across + 0.4, width), height=height * down, whole=True
    )
    return Figure(key, title, caption, panels, standalone(sheet.svg))


def standalone(svg: str) -> str:
    """An inline svg as the text of a file that is legible on light and dark pages."""
    head = re.match(r"<svg[^>]*>", svg)
    if head is None:
        raise ValueError("not an svg element")
    return '<?xml version="1.0" encoding="utf-8"?>\n' + head[0] + PAPER + svg[head.end() :].rstrip() + "\n"
