"""Looks of policies: color, marker and dashes, the same in all plots and on the page.

No meaning rests on color alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

# Okabe and Ito without yellow, which white pages swallow, and without black, which dark ones do.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"


# Then what is farthest from these and from each other, and still seen on white and on dark pages.
PALETTE = (
    *(BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY),
    *("#8a2be2", "#c2185b", "#7a5c3e", "#7d7af5", "#8c8400", "#e03ad0"),
    *("#5da800", "#f0506e", "#3f51e0", "#9a6bb0", "#a8957c", "#1f7a1f"),
)


# What matplotlib and the page's style sheet call the same shape.
SHAPES = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle", "P": "plus", "X": "cross"}
_DASHES: tuple[Any, ...] = (
    "-",
    (0, (4, 1.6)),
    (0, (1.2, 1.2)),
    (0, (7, 1.5, 1.2, 1.5)),
    (0, (2.2, 0.8)),
    (0, (9, 2)),
)


_SAFE = 6  # colors in a row that color-blind readers can tell apart


@dataclass(frozen=True)
class Look:
    """Look of a policy: `marker` and `dash` as matplotlib takes them, `shape` for the style sheet."""

    color: str
    marker: str
    dash: Any

    @property
    def shape(self) -> str:
        """The marker's name."""
        return SHAPES[self.marker]


def make_looks(policies: Sequence[str]) -> dict[str, Look]:
    """A look for each policy, in the order given.

    The first 18 have colors of their own; every six there is another marker with other dashes, so that no
    two of 36 look the same, and color-blind readers can tell them apart.
    """
    markers = tuple(SHAPES)
    return {
        policy: Look(
            PALETTE[number % len(PALETTE)],
            markers[number // _SAFE % len(markers)],
            _DASHES[number // _SAFE % len(_DASHES)],
        )
        for number, policy in enumerate(policies)
    }
