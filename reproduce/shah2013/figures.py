"""Figures 2 to 5 of the paper from our runs, the same for the method beyond it, and what random cases say."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from reproduce.animation import Chain, Movie, Scene, animate
from reproduce.compare import figures_of
from reproduce.figures import Figure, Sketch, figure
from reproduce.shah2013.deciding import ratio
from reproduce.shah2013.methods import METHODS, Method
from reproduce.shah2013.runs import Worked
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.report.drawing import INK
from space_envs.evaluation.report.figures import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from space_envs.robots.parameters import DUAL_ARM_PLANAR

POINTS = 161  # drawn of a curve
FLOOR = 1e-18  # rad/s; what is less, zero included, is drawn there
FRAMES = 61  # of the animation
ARROWS = 11  # velocity vectors drawn along each path
ARROW_SECONDS = 1.5  # of motion that an arrow is long
LOOP = 10.0  # s that the motion takes in it
ARM_COLOURS = (BLUE, VERMILION)
DASHES = ("-", (0, (4, 1.6)))
SUBSCRIPTS = "₁₂"
DASHES_MORE = ((0, (4, 1.6)), (0, (1.2, 1.2)))
NAMES = {"zeta_zero": "fig3", "local": "fig4", "ocp": "fig5", "free": "free"}


def independent_velocities(worked: Worked) -> Figure:
    """Fig. 2: the same for every method that follows the polynomial paths."""
    course = worked.curves["zeta_zero"]
    kept = _kept(course.time)

    def draw(axes: Axes) -> None:
        for number, name in enumerate(("v₁ x", "v₁ y", "v₂ x", "v₂ y")):
            axes.plot(
                course.time[kept],
                100 * course.velocity[kept, number],
                color=ARM_COLOURS[number // 2],
                ls=DASHES[number % 2],
                lw=1.9,
                label=name,
            )
        _dress(axes, course.time, "independent velocities [cm/s]")
        axes.legend(ncols=2)

    arrows = np.linspace(0, len(course.time) - 1, ARROWS).round().astype(int)

    def vectors(axes: Axes) -> None:
        for arm, colour in enumerate(ARM_COLOURS):
            place, velocity = course.place[:, arm], course.velocity[:, 2 * arm : 2 * arm + 2]
            axes.plot(*place.T, color=colour, lw=1.1, alpha=0.6)
            axes.quiver(
                *place[arrows].T,
                *(ARROW_SECONDS * velocity[arrows]).T,
                color=colour,
                angles="xy",
                scale_units="xy",
                scale=1.0,
                width=0.009,
            )
            axes.plot(*place[-1], "o", color=INK, ms=4)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid()

    speed = 100 * np.abs(course.velocity).max(axis=0)
    end = ", ".join(f"{100 * value:+.2f}" for value in course.velocity[-1])
    alt = (
        "Linear velocities of the two end-effectors over time; largest "
        + ", ".join(f"{value:.1f}" for value in speed)
        + f" cm/s, at the end {end} cm/s."
    )
    return figure(
        "fig2",
        "Fig. 2: independent velocities",
        "Linear velocities of end-effector 1 (blue) and 2 (orange), x solid and y dashed, by eq. 11 for the "
        "canonical case. Methods (a), (b), (c) share them. Right: the same as vectors, every "
        f"{course.time[arrows[1]]:g} s along the paths of the end-effectors to the grapple points; an arrow "
        f"is as long as {ARROW_SECONDS:g} s of its motion.",
        (
            Sketch(draw, alt),
            Sketch(
                vectors,
                f"The velocities of both end-effectors as {2 * ARROWS} arrows along their paths in the "
                f"plane, from rest to {_ends(course.velocity[-1])} m/s at the grapple points.",
            ),
        ),
        height=3.2,
    )


def _ends(velocity: Array) -> str:
    """Two velocities in the plane (4,), m/s, as words."""
    return " and ".join(f"({x:+.2f}, {y:+.2f})" for x, y in (velocity + 0.0).round(2).reshape(2, 2) + 0.0)


def method_figure(worked: Worked, method: Method) -> Figure | None:
    """Fig. 3, 4 or 5, or the same panels of the method with free paths; None where it found no plan."""
    if method.key not in worked.plans:
        return None
    course, key = worked.curves[method.key], method.key
    kept = _kept(course.time)
    time = course.time[kept]

    def pair(values: Array, name: str, label: str, unit: str = "rad/s") -> Sketch:
        def draw(axes: Axes) -> None:
            for number in range(2):
                text = f"{name}{SUBSCRIPTS[number]}"
                axes.plot(
                    time,
                    values[kept, number],
                    color=ARM_COLOURS[number],
                    ls=DASHES[number],
                    lw=1.9,
                    label=text,
                )
            _dress(axes, course.time, f"{label} [{unit}]")
            if np.abs(values).max() < 1e-6:
                axes.set_ylim(-0.01, 0.01)
            axes.legend(ncols=2)

        return Sketch(draw, f"{label}: from {values.min():.3g} to {values.max():.3g} {unit}.")

    def base(axes: Axes) -> None:
        _base_rates(axes, worked, key)

    def energy(axes: Axes) -> None:
        axes.plot(time, course.energy[kept], color=method.colour, lw=2.1)
        _dress(axes, course.time, "energy [J s]")
        axes.set_ylim(bottom=0)

    def power(axes: Axes) -> None:
        axes.plot(time, 1000 * course.power[kept], color=method.colour, lw=2.1, label="Σ |τ θ̇|")
        axes.plot(time, 1000 * course.net[kept], color=INK, lw=1.1, ls=DASHES[1], label="Σ τ θ̇")
        _dress(axes, course.time, "power [mW]")
        axes.legend(ncols=2)

    def joints(axes: Axes) -> None:
        for number in range(6):
            axes.plot(
                time,
                course.rate[kept, number],
                color=ARM_COLOURS[number // 3],
                ls=("-", *DASHES_MORE)[number % 3],
                lw=1.6,
                label=f"{number // 3 + 1}.{number % 3 + 1}",
            )
        _dress(axes, course.time, "joint rates [rad/s]")
        axes.legend(ncols=3)

    figures = figures_of(worked.record, key) or {}
    rates = f"{figures['tracked_base_rate']:.1e} and {figures['tracked_base_rate_fine']:.1e}"
    sketches = [
        pair(course.zeta, "ζ", "null-space velocity ζ"),
        pair(course.turning, "ω", "dependent velocities"),
        Sketch(
            base,
            f"Base angular velocity: {figures['base_rate']:.1e} rad/s re-integrated, {rates} rad/s "
            "simulated at torque level.",
        ),
        Sketch(energy, f"Energy grows to {course.energy[-1]:.4f} J s."),
        Sketch(power, f"Power: at most {1000 * course.power.max():.1f} mW."),
        Sketch(joints, f"Joint rates: at most {np.abs(course.rate).max():.3f} rad/s."),
    ]
    titles = {
        "zeta_zero": "Fig. 3: reactionless manipulation, ζ = 0 (a)",
        "local": "Fig. 4: local optimisation (b)",
        "ocp": "Fig. 5: optimal control (c)",
        "free": "Beyond the paper: free paths (d)",
    }
    caption = (
        f"Canonical case, C = {figures['energy']:.4f} J s. Null-space velocity: the part of ζ that the "
        "projector of eq. 9 lets through. Base: re-integrated as in the paper, and simulated at torque "
        "level. "
        "Joints: arm and number." + _jump_note(figures)
    )
    return figure(NAMES[key], titles[key], caption, sketches)


def comparison(worked: Worked) -> Figure:
    """Energy and power of all methods in one pair of axes each."""
    shown = [METHODS[key] for key in NAMES if key in worked.curves]

    def curve(name: str, scale: float, label: str) -> Sketch:
        def draw(axes: Axes) -> None:
            for method in shown:
                course = worked.curves[method.key]
                kept = _kept(course.time)
                axes.plot(
                    course.time[kept],
                    scale * getattr(course, name)[kept],
                    color=method.colour,
                    lw=1.9,
                    label=f"({method.letter})",
                )
            _dress(axes, worked.curves[shown[0].key].time, label)
            axes.set_ylim(bottom=0)
            axes.legend(ncols=2)

        peak = "; ".join(
            f"({m.letter}) {scale * getattr(worked.curves[m.key], name).max():.4g}" for m in shown
        )
        return Sketch(draw, f"{label}, largest: {peak}.")

    def draw_bars(axes: Axes) -> None:
        methods = [METHODS[key] for key in METHODS if key in worked.plans]
        values = [worked.plans[method.key].energy for method in methods]
        axes.barh(range(len(values)), values, height=0.62, color=[method.colour for method in methods])
        for number, value in enumerate(values):
            axes.annotate(
                f"{value:.4f}", (value, number), (4, 0), textcoords="offset points", va="center", fontsize=9
            )
        axes.set_yticks(range(len(values)), [f"({method.letter})" for method in methods])
        axes.set(ylim=(len(values) - 0.5, -0.5), xlim=(0, 1.25 * max(values)), xlabel="C [J s]")
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x")

    bars = Sketch(
        draw_bars,
        "C: "
        + "; ".join(f"({METHODS[key].letter}) {plan.energy:.4f} J s" for key, plan in worked.plans.items())
        + ".",
    )
    return figure(
        "comparison",
        "Energy and power side by side",
        "Canonical case. Energy is the integral of eq. 15 so far, power the sum of |torque × rate| over the "
        "joints. Bars: C of eq. 15 over the whole motion.",
        (bars, curve("energy", 1.0, "energy [J s]"), curve("power", 1000.0, "power [mW]")),
        height=3.1,
    )


def ratios(records: Sequence[Mapping[str, Any]], own: Mapping[str, Any]) -> Figure | None:
    """Distributions of the energies' ratios over the random cases, with the canonical case marked."""
    pairs = (
        ("(b) / (a)", "local", ("zeta_zero",), VERMILION),
        ("(c) / best of (a), (b)", "ocp", ("zeta_zero", "local"), GREEN),
        ("(d) / (c)", "free", ("ocp",), PURPLE),
    )
    found = [
        (name, _ratios(records, key, others), ratio(own, key, others), colour)
        for name, key, others, colour in pairs
    ]
    found = [each for each in found if each[1].size]
    if not found:
        return None

    def sketch(name: str, values: Array, canonical: float | None, colour: str) -> Sketch:
        def draw(axes: Axes) -> None:
            ordered = np.sort(values)
            share = 100 * (np.arange(values.size) + 1) / values.size
            axes.step(
                np.concatenate([ordered[:1], ordered]), np.concatenate([[0.0], share]), color=colour, lw=2.1
            )
            axes.plot(ordered, np.full(values.size, -5.0), "|", color=colour, ms=7, alpha=0.7)
            axes.axvline(1.0, color=INK, lw=0.8, ls=DASHES[1])
            if canonical is not None:
                axes.axvline(canonical, color=colour, lw=1.4, alpha=0.6)
                axes.annotate(
                    "canonical",
                    (canonical, 100),
                    (-3 if canonical > np.median(values) else 3, -2),
                    textcoords="offset points",
                    fontsize=8,
                    color=INK,
                    va="top",
                    ha="right" if canonical > np.median(values) else "left",
                )
            axes.set(xlabel=f"energy {name}", ylabel="cases up to here [%]", ylim=(-9, 104))
            axes.xaxis.set_major_locator(MaxNLocator(6))
            axes.grid()

        low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
        return Sketch(
            draw,
            f"Energy of {name} over {values.size} cases: median {middle:.3f}, tenth to ninetieth percentile "
            f"{low:.3f} to {high:.3f}.",
        )

    return figure(
        "ratios",
        "How the energies compare over random cases",
        "Distribution functions of the ratios of C; left of the dashed line the first method needs less. "
        "Ticks are single cases. Only cases in which the methods named found a plan.",
        [sketch(*each) for each in found],
    )


def movie(worked: Worked) -> Movie:
    """The canonical capture by all four methods."""
    shown = [METHODS[key] for key in NAMES if key in worked.plans]
    most = max(float(worked.curves[method.key].energy[-1]) for method in shown)
    scenes = []
    for method in shown:
        course, case = worked.curves[method.key], worked.case
        rows = np.linspace(0, len(course.time) - 1, FRAMES).round().astype(np.int64)
        turn = case.angle + case.spin * (course.time[rows] - course.time[-1])
        lengths = [link.length for link in DUAL_ARM_PLANAR.arm]
        scenes.append(
            Scene(
                title=method.title,
                base=course.base[rows],
                turn=np.zeros(FRAMES),
                chains=[
                    Chain(
                        np.array(mount),
                        lengths,
                        course.position[rows, 3 * arm : 3 * arm + 3],
                        (method.colour, SKY if method.colour != SKY else ORANGE)[arm],
                    )
                    for arm, mount in enumerate(DUAL_ARM_PLANAR.mounts)
                ],
                target=np.array(case.centre),
                target_turn=turn,
                grapples=case.grapples,
                trails=[course.place[rows, arm] for arm in range(2)],
                level=course.energy[rows],
                most=most,
                label=f"C = {worked.plans[method.key].energy:.4f} J s",
            )
        )
    svg, seconds = animate(scenes, LOOP, (-1.3, -1.0, 3.2, 2.6))
    energies = "; ".join(f"{scene.title}: {scene.label}" for scene in scenes)
    return Movie(
        "capture",
        "The canonical capture",
        f"{worked.case.duration:g} s of motion at {worked.case.duration / LOOP:g} times its speed. The "
        "satellite keeps its attitude and is free to move; dotted: the end-effectors' paths; the bar fills "
        "with the energy used so far. Methods (a), (b), (c) follow the same paths with different joint "
        "motions.",
        svg,
        "Animation of the planar dual-arm robot taking the turning target by its two grapple points. "
        f"{energies}.",
        motion=worked.case.duration,
        seconds=seconds,
    )


def _base_rates(axes: Axes, worked: Worked, key: str) -> None:
    course = worked.curves[key]
    for time, rate, colour, label in (
        (
            worked.coarse[key].time,
            worked.coarse[key].base_rate[:, 2],
            VERMILION,
            "simulated, suite's step",
        ),
        (worked.fine[key].time, worked.fine[key].base_rate[:, 2], BLUE, "simulated, fine"),
        (course.time, course.base_rate, INK, "re-integrated"),
    ):
        peak_time, peak = _envelope(time, rate)
        axes.plot(peak_time, np.maximum(peak, FLOOR), color=colour, lw=1.6, label=label)
    axes.axhline(1e-9, color=INK, lw=0.7, ls=DASHES[1])
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0e}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    _dress(axes, course.time, "|base angular velocity| [rad/s]")
    low = min(axes.get_ylim()[0], 1e-13)
    axes.set_ylim(max(low, 0.3 * FLOOR), 1e-3 if axes.get_ylim()[1] < 1e-4 else None)
    axes.legend(ncols=1, loc="upper left", fontsize=8)


def _envelope(time: Array, values: Array, bins: int = 120) -> tuple[Array, Array]:
    """Largest magnitude in each of `bins` equal stretches, for a signal that goes through zero often."""
    edges = np.linspace(0, len(time), bins + 1).astype(int)
    pairs = [(a, b) for a, b in zip(edges, edges[1:], strict=False) if b > a]
    middle = np.array([time[a:b].mean() for a, b in pairs])
    return middle, np.array([np.abs(values[a:b]).max() for a, b in pairs])


def _kept(time: Array) -> NDArray[np.int64]:
    return np.linspace(0, len(time) - 1, POINTS).round().astype(np.int64)


def _dress(axes: Axes, time: Array, label: str) -> None:
    axes.set(xlim=(0, float(time[-1])), xlabel="time [s]", ylabel=label)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.grid()


def _ratios(records: Sequence[Mapping[str, Any]], key: str, others: tuple[str, ...]) -> Array:
    found = [ratio(record, key, others) for record in records]
    return np.array([value for value in found if value is not None])


def _jump_note(figures: Mapping[str, float]) -> str:
    if figures["start_energy"] < 1e-9:
        return ""
    return (
        " The joint rates jump at t = 0; the simulation starts at rest and needs a control period to follow."
    )
