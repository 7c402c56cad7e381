"""Labels of points that cover as few points and other labels as possible."""

import math
from collections.abc import Sequence
from typing import cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from space_envs.evaluation.report.drawing.panel import INK

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
