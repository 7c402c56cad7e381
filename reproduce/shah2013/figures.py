"""Figures 2 to 5 of the paper from our runs, and the same for the method beyond it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

from reproduce.compare import figures_of
from reproduce.page.drawing import DASHES, place_axes, time_axes
from reproduce.page.figures import Draw, Figure, figure
from reproduce.shah2013.measures import Curves
from reproduce.shah2013.methods import DualArmMethod
from reproduce.shah2013.runs import PlannedCase
from reproduce.shah2013.text import TEXT
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.report.drawing.look import BLUE, VERMILION
from space_envs.evaluation.report.drawing.panel import INK

POINTS = 161  # drawn of a curve
FLOOR = 1e-18  # rad/s; smaller rates, zero included, are drawn there
ARROWS = 11  # velocity vectors drawn along each path
ARROW_SECONDS = 1.5  # of motion that an arrow is long
ARM_COLORS = (BLUE, VERMILION)
SUBSCRIPTS = "₁₂"
FIGURES = {"zeta_zero": "fig3", "local": "fig4", "ocp": "fig5", "free": "free"}  # by method


def independent_velocities(planned: PlannedCase) -> Figure:
    """Fig. 2: the same for every method that follows the polynomial paths."""
    course = planned.curves["zeta_zero"]
    arrows = np.linspace(0, len(course.time) - 1, ARROWS).round().astype(int)
    text = TEXT.fill(
        "figures.fig2",
        interval=course.time[arrows[1]],
        arrow=ARROW_SECONDS,
        largest=100 * np.abs(course.velocity).max(axis=0),
        end=100 * course.velocity[-1],
        arrows=2 * ARROWS,
        ends=_ends(course.velocity[-1]),
    )
    draws = (lambda axes: _draw_velocities(axes, course), lambda axes: _draw_vectors(axes, course, arrows))
    return figure("fig2", text, draws, height=3.2)


def _draw_velocities(axes: Axes, course: Curves) -> None:
    drawn = drawn_samples(course.time)
    for number, name in enumerate(("v₁ x", "v₁ y", "v₂ x", "v₂ y")):
        axes.plot(
            course.time[drawn],
            100 * course.velocity[drawn, number],
            color=ARM_COLORS[number // 2],
            ls=DASHES[number % 2],
            lw=1.9,
            label=name,
        )
    time_axes(axes, course.time, "independent velocities [cm/s]")
    axes.legend(ncols=2)


def _draw_vectors(axes: Axes, course: Curves, arrows: NDArray[np.int64]) -> None:
    for arm, color in enumerate(ARM_COLORS):
        place, velocity = course.place[:, arm], course.velocity[:, 2 * arm : 2 * arm + 2]
        axes.plot(*place.T, color=color, lw=1.1, alpha=0.6)
        axes.quiver(
            *place[arrows].T,
            *(ARROW_SECONDS * velocity[arrows]).T,
            color=color,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.009,
        )
        axes.plot(*place[-1], "o", color=INK, ms=4)
    place_axes(axes, ("x [m]", "y [m]"), adjustable="datalim")
    axes.grid()


def _ends(velocity: Array) -> str:
    """Two velocities in the plane (4,), m/s, as words."""
    return " and ".join(f"({x:+.2f}, {y:+.2f})" for x, y in (velocity + 0.0).round(2).reshape(2, 2) + 0.0)


def method_figure(planned: PlannedCase, method: DualArmMethod) -> Figure | None:
    """Fig. 3, 4 or 5, or the same panels of the method with free paths; None where it found no plan."""
    figures = figures_of(planned.record, method.key)
    if method.key not in planned.plans or figures is None:
        return None
    course = planned.curves[method.key]
    text: Mapping[str, Any] = TEXT.fill(
        "figures.method",
        figures=figures,
        course=course,
        peak_rate=np.abs(course.rate).max(),
        jumps=figures["start_energy"] >= 1e-9,
    )
    draws = (
        _pair(course, course.zeta, "ζ", "null-space velocity ζ [rad/s]"),
        _pair(course, course.angular, "ω", "dependent velocities [rad/s]"),
        lambda axes: _draw_base_rates(axes, planned, method.key),
        lambda axes: _draw_energy(axes, course, method.color),
        lambda axes: _draw_power(axes, course, method.color),
        lambda axes: _draw_joint_rates(axes, course),
    )
    title = text["titles"][method.key]
    return figure(FIGURES[method.key], {**text, "title": title}, draws)


def _pair(course: Curves, values: Array, name: str, label: str) -> Draw:
    """Function that draws two quantities (K, 2), one of each arm."""

    def draw(axes: Axes) -> None:
        drawn = drawn_samples(course.time)
        for number in range(2):
            axes.plot(
                course.time[drawn],
                values[drawn, number],
                color=ARM_COLORS[number],
                ls=DASHES[number],
                lw=1.9,
                label=f"{name}{SUBSCRIPTS[number]}",
            )
        time_axes(axes, course.time, label)
        if np.abs(values).max() < 1e-6:
            axes.set_ylim(-0.01, 0.01)
        axes.legend(ncols=2)

    return draw


def _draw_energy(axes: Axes, course: Curves, color: str) -> None:
    drawn = drawn_samples(course.time)
    axes.plot(course.time[drawn], course.energy[drawn], color=color, lw=2.1)
    time_axes(axes, course.time, "energy [J s]")
    axes.set_ylim(bottom=0)


def _draw_power(axes: Axes, course: Curves, color: str) -> None:
    drawn = drawn_samples(course.time)
    time = course.time[drawn]
    axes.plot(time, 1000 * course.power[drawn], color=color, lw=2.1, label="Σ |τ θ̇|")
    axes.plot(time, 1000 * course.net[drawn], color=INK, lw=1.1, ls=DASHES[1], label="Σ τ θ̇")
    time_axes(axes, course.time, "power [mW]")
    axes.legend(ncols=2)


def _draw_joint_rates(axes: Axes, course: Curves) -> None:
    drawn = drawn_samples(course.time)
    for number in range(6):
        axes.plot(
            course.time[drawn],
            course.rate[drawn, number],
            color=ARM_COLORS[number // 3],
            ls=DASHES[number % 3],
            lw=1.6,
            label=f"{number // 3 + 1}.{number % 3 + 1}",
        )
    time_axes(axes, course.time, "joint rates [rad/s]")
    axes.legend(ncols=3)


def _draw_base_rates(axes: Axes, planned: PlannedCase, key: str) -> None:
    course, coarse, fine = planned.curves[key], planned.coarse[key], planned.fine[key]
    for time, rate, color, label in (
        (coarse.time, coarse.base_rate[:, 2], VERMILION, "simulated, suite's step"),
        (fine.time, fine.base_rate[:, 2], BLUE, "simulated, fine"),
        (course.time, course.base_rate, INK, "re-integrated"),
    ):
        peak_time, peak = _envelope(time, rate)
        axes.plot(peak_time, np.maximum(peak, FLOOR), color=color, lw=1.6, label=label)
    axes.axhline(1e-9, color=INK, lw=0.7, ls=DASHES[1])
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0e}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    time_axes(axes, course.time, "|base angular velocity| [rad/s]")
    low = min(axes.get_ylim()[0], 1e-13)
    axes.set_ylim(max(low, 0.3 * FLOOR), 1e-3 if axes.get_ylim()[1] < 1e-4 else None)
    axes.legend(ncols=1, loc="upper left", fontsize=8)


def _envelope(time: Array, values: Array, bins: int = 120) -> tuple[Array, Array]:
    """Largest magnitude in each of `bins` equal stretches, for a signal that goes through zero often."""
    edges = np.linspace(0, len(time), bins + 1).astype(int)
    pairs = [(a, b) for a, b in zip(edges, edges[1:], strict=False) if b > a]
    middle = np.array([time[a:b].mean() for a, b in pairs])
    return middle, np.array([np.abs(values[a:b]).max() for a, b in pairs])


def drawn_samples(time: Array) -> NDArray[np.int64]:
    """Indices of the samples of a curve that are drawn."""
    return np.linspace(0, len(time) - 1, POINTS).round().astype(np.int64)
