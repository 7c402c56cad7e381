"""Figures of a page: panels drawn inline, and the same panels side by side in a file of their own."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes

from space_envs.evaluation.report.drawing.panel import LONE, WIDTH, Panel, draw_panel

GAP = 12.0  # points, around each panel of a file
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

    kind = "figure"

    @property
    def alt(self) -> str:
        """The sentences of all panels."""
        return " ".join(panel.alt for panel in self.panels)


def figure(
    key: str, text: Mapping[str, Any], draws: Sequence[Draw], columns: int = 3, height: float = 2.7
) -> Figure:
    """Draw the panels one by one, and all of them together in rows of `columns`.

    Args:
        text: `title`, `caption`, and `alt` with a sentence for each panel.
        draws: functions that draw the panels into axes. height: in inches.
    """
    width = WIDTH if len(draws) > 1 else LONE
    panels = tuple(
        draw_panel(f"{key}-{number}", draw, alt, width=width, height=height)
        for number, (draw, alt) in enumerate(zip(draws, text["alt"], strict=True))
    )
    return Figure(key, text["title"], text["caption"], panels, standalone(_sheet(panels, columns)))


def _sheet(panels: Sequence[Panel], columns: int) -> str:
    """Panels of one size as one svg, in rows."""
    found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', panels[0].svg)
    if found is None:
        raise ValueError("a panel without a view box")
    width, height = float(found[1]), float(found[2])
    across = min(columns, len(panels))
    total = across * (width + GAP) + GAP, -(-len(panels) // across) * (height + GAP) + GAP
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total[0]:g} {total[1]:g}">']
    for number, panel in enumerate(panels):
        x, y = GAP + number % across * (width + GAP), GAP + number // across * (height + GAP)
        place = f'<svg x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
        parts.append(panel.svg.strip().replace("<svg", place, 1))
    return "".join([*parts, "</svg>"])


def standalone(svg: str) -> str:
    """An inline svg as the text of a file that is legible on light and dark pages."""
    head = re.match(r"<svg[^>]*>", svg)
    if head is None:
        raise ValueError("not an svg element")
    return '<?xml version="1.0" encoding="utf-8"?>\n' + head[0] + PAPER + svg[head.end() :].rstrip() + "\n"
