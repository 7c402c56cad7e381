"""Axes that the figures of both papers share."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from space_envs.dynamics.rotations import Array

DASHES = ("-", (0, (4, 1.6)), (0, (1.2, 1.2)))
AXES = "xyz"


def time_axes(axes: Axes, time: Array, label: str) -> None:
    """Label axes over times (K,) s, with a grid."""
    axes.set(xlim=(0, float(time[-1])), xlabel="time [s]", ylabel=label)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.grid()


def shares(values: Array) -> Array:
    """Percentages (K,) of K cases up to each, for a distribution function."""
    return 100 * (np.arange(values.size) + 1) / values.size


def place_axes(
    axes: Axes, labels: Sequence[str], adjustable: Literal["box", "datalim"] | None = None
) -> None:
    """Label axes of two coordinates in m, of equal scale."""
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set(xlabel=labels[0], ylabel=labels[1])
