"""Figures 4 to 6 of shyam2020 from our runs: costs, motion of the base, and basis functions."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from agents.policies.single_arm.promp import prior_of
from promp import GaussianBasis
from reproduce.page.drawing import AXES, DASHES
from reproduce.page.figures import Draw, Figure, figure
from reproduce.shyam2020.cases import context
from reproduce.shyam2020.measures import Course
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.page.text import TEXT
from reproduce.shyam2020.runs import PlannedGoal
from reproduce.shyam2020.sampling import SHOWN, DrawnSamples
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, SKY, VERMILION
from space_envs.evaluation.report.drawing.panel import INK

COLORS = (BLUE, VERMILION, GREEN)
EVERY = 10  # samples of a course between those that are drawn
COMPARED = ("minimum_jerk", "promp_mean", "promp", "promp_optimal", "ocp")


def costs(planned: PlannedGoal, drawn: DrawnSamples) -> Figure:
    """Fig. 4: costs of twenty samples, the least marked, and of all hundred with those of the planners."""
    shown = 1e4 * drawn.cost[:SHOWN]
    text = TEXT.fill(
        "figures.fig4",
        least=shown.min(),
        largest=shown.max(),
        best=int(shown.argmin()) + 1,
        least_of_all=1e4 * drawn.cost.min(),
    )
    draws = (
        lambda axes: _draw_bars(axes, shown),
        lambda axes: _draw_spread(axes, planned, 1e4 * drawn.cost),
    )
    return figure("fig4", text, draws, columns=2, height=3.1)


def _draw_bars(axes: Axes, shown: Array) -> None:
    best = int(shown.argmin())
    colors = [VERMILION if number == best else SKY for number in range(SHOWN)]
    axes.bar(np.arange(1, SHOWN + 1), shown, color=colors, width=0.7)
    axes.annotate(
        "least",
        (best + 1, shown[best]),
        (best + 1, 1.08 * shown.max()),
        ha="center",
        arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.7},
    )
    axes.set(xlabel="trajectory", ylabel="base disturbance (eq. 20) [cm²/s]")
    axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
    axes.grid(axis="y")


def _draw_spread(axes: Axes, planned: PlannedGoal, cost: Array) -> None:
    axes.hist(cost, bins=20, color=SKY, alpha=0.8)
    top = axes.get_ylim()[1]
    for number, key in enumerate(name for name in COMPARED if name in planned.courses):
        value, method = 1e4 * planned.courses[key].cost, METHODS[key]
        axes.axvline(value, color=method.color, lw=1.8, ls=DASHES[number % 3], label=method.name)
    axes.set(xlabel="base disturbance (eq. 20) [cm²/s]", ylabel="samples")
    axes.set(xlim=(0, None), ylim=(0, 1.75 * top))
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.legend(fontsize=8, loc="upper right")


def base_motion(planned: PlannedGoal, key: str, name: str) -> Figure | None:
    """Fig. 5, of one method: rotation and translation of the base; None where it has no motion.

    Args:
        name: of the figure, with its words in `figures.base`.
    """
    if key not in planned.courses:
        return None
    course = planned.courses[key]
    rotation, translation = np.rad2deg(course.rotation), 100 * course.base
    words = TEXT.fill(f"figures.base.{name}")
    values = {
        "what": words["what"],
        "course": course,
        "end": course.angle[-1],
        "peak": course.angle.max(),
        "rotation": rotation,
        "largest_rotation": np.abs(rotation).max(),
        "translation": translation,
        "largest_translation": np.abs(translation).max(),
    }
    text = {part: TEXT.fill(f"figures.base.{part}", **values) for part in ("caption", "alt")}
    draws = (_vector(course, rotation, "rotation [deg]"), _vector(course, translation, "translation [cm]"))
    return figure(name, {"title": words["title"], **text}, draws, columns=2, height=2.9)


def _vector(course: Course, values: Array, label: str) -> Draw:
    """Function that draws the components (K, 3) of a vector over time."""

    def draw(axes: Axes) -> None:
        for number, axis in enumerate(AXES):
            axes.plot(
                course.time[::EVERY],
                values[::EVERY, number],
                color=COLORS[number],
                ls=DASHES[number],
                lw=1.9,
                label=axis,
            )
        axes.set(xlabel="time [s]", ylabel=label, xlim=(0, course.time[-1]))
        axes.grid()
        axes.legend(ncols=3)

    return draw


def basis() -> Figure:
    """Fig. 6: the basis functions."""
    functions = prior_of(context().robot).basis
    text = TEXT.fill("figures.fig6", basis=functions)
    return figure("fig6", text, (lambda axes: _draw_basis(axes, functions),), height=2.9)


def _draw_basis(axes: Axes, functions: GaussianBasis) -> None:
    phase = np.linspace(0.0, 1.0, 201)
    values = functions.value(phase)
    for number in range(functions.size):
        axes.plot(phase, values[:, number], color=(*COLORS, SKY)[number % 4], lw=1.9)
    axes.set(xlabel="phase", ylabel="ψ", xlim=(0, 1), ylim=(0, 1.05))
    axes.grid()
