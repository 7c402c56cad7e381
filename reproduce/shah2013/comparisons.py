"""The methods side by side: energy, power and motion in the canonical case, ratios over random cases."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from reproduce.claims import CaseRecord
from reproduce.compare import ratio, ratios
from reproduce.page.animation import AnimatedRobot, Chain, Movie, animate
from reproduce.page.drawing import DASHES, shares, time_axes
from reproduce.page.figures import Draw, Figure, figure
from reproduce.shah2013.cases import ROBOT
from reproduce.shah2013.figures import FIGURES, drawn_samples
from reproduce.shah2013.methods import METHODS, DualArmMethod
from reproduce.shah2013.runs import PlannedCase
from reproduce.shah2013.text import TEXT
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.report.drawing.look import GREEN, ORANGE, PURPLE, SKY, VERMILION
from space_envs.evaluation.report.drawing.panel import INK
from space_envs.robots.robot import Arm

FRAMES = 61  # of the animation
LOOP = 10.0  # s that the motion takes in it
RATIOS = (
    ("(b) / (a)", "local", ("zeta_zero",), VERMILION),
    ("(c) / best of (a), (b)", "ocp", ("zeta_zero", "local"), GREEN),
    ("(d) / (c)", "free", ("ocp",), PURPLE),
)


def comparison(planned: PlannedCase) -> Figure:
    """Energy and power of all methods in one pair of axes each."""
    shown = [METHODS[key] for key in FIGURES if key in planned.curves]
    curves = (("energy", 1.0, "energy [J s]"), ("power", 1000.0, "power [mW]"))
    peaks = [
        "; ".join(f"({m.letter}) {scale * getattr(planned.curves[m.key], name).max():.4g}" for m in shown)
        for name, scale, _ in curves
    ]
    energies = "; ".join(
        f"({METHODS[key].letter}) {plan.energy:.4f} J s" for key, plan in planned.plans.items()
    )
    text = TEXT.fill("figures.comparison", energies=energies, peaks=peaks)
    draws = (lambda axes: _draw_bars(axes, planned), *(_curve(planned, shown, *curve) for curve in curves))
    return figure("comparison", text, draws, height=3.1)


def _curve(planned: PlannedCase, shown: Sequence[DualArmMethod], name: str, scale: float, label: str) -> Draw:
    """Function that draws a quantity of `Curves` over time, of all methods."""

    def draw(axes: Axes) -> None:
        for method in shown:
            course = planned.curves[method.key]
            drawn = drawn_samples(course.time)
            values = scale * getattr(course, name)[drawn]
            axes.plot(course.time[drawn], values, color=method.color, lw=1.9, label=f"({method.letter})")
        time_axes(axes, planned.curves[shown[0].key].time, label)
        axes.set_ylim(bottom=0)
        axes.legend(ncols=2)

    return draw


def _draw_bars(axes: Axes, planned: PlannedCase) -> None:
    methods = [METHODS[key] for key in METHODS if key in planned.plans]
    values = [planned.plans[method.key].energy for method in methods]
    axes.barh(range(len(values)), values, height=0.62, color=[method.color for method in methods])
    for number, value in enumerate(values):
        axes.annotate(
            f"{value:.4f}", (value, number), (4, 0), textcoords="offset points", va="center", fontsize=9
        )
    axes.set_yticks(range(len(values)), [f"({method.letter})" for method in methods])
    axes.set(ylim=(len(values) - 0.5, -0.5), xlim=(0, 1.25 * max(values)), xlabel="C [J s]")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x")


def energy_ratios(records: Sequence[CaseRecord], own: CaseRecord) -> Figure | None:
    """Distributions of the energies' ratios over the random cases, with the canonical case marked."""
    draws: list[Draw] = []
    sentences: list[str] = []
    for name, key, others, color in RATIOS:
        values = ratios(records, "energy", key, *others)
        if not values.size:
            continue
        draws.append(_distribution(name, values, ratio(own, "energy", key, *others), color))
        low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
        sentence = TEXT.fill(
            "figures.ratios.alt", name=name, count=values.size, low=low, middle=middle, high=high
        )
        sentences += sentence
    if not draws:
        return None
    title, caption = (TEXT.fill(f"figures.ratios.{part}") for part in ("title", "caption"))
    return figure("ratios", {"title": title, "caption": caption, "alt": sentences}, draws)


def _distribution(name: str, values: Array, canonical: float | None, color: str) -> Draw:
    """Function that draws the distribution function of ratios (K,), and that of the canonical case."""

    def draw(axes: Axes) -> None:
        ordered = np.sort(values)
        steps = np.concatenate([ordered[:1], ordered]), np.concatenate([[0.0], shares(values)])
        axes.step(*steps, color=color, lw=2.1)
        axes.plot(ordered, np.full(values.size, -5.0), "|", color=color, ms=7, alpha=0.7)
        axes.axvline(1.0, color=INK, lw=0.8, ls=DASHES[1])
        if canonical is not None:
            right = canonical > np.median(values)
            axes.axvline(canonical, color=color, lw=1.4, alpha=0.6)
            axes.annotate(
                "canonical",
                (canonical, 100),
                (-3 if right else 3, -2),
                textcoords="offset points",
                fontsize=8,
                color=INK,
                va="top",
                ha="right" if right else "left",
            )
        axes.set(xlabel=f"energy {name}", ylabel="cases up to here [%]", ylim=(-9, 104))
        axes.xaxis.set_major_locator(MaxNLocator(6))
        axes.grid()

    return draw


def movie(planned: PlannedCase) -> Movie:
    """Animation of the canonical capture by the paper's methods and by free paths."""
    shown = [METHODS[key] for key in FIGURES if key in planned.plans]
    most = max(float(planned.curves[method.key].energy[-1]) for method in shown)
    scenes = [_animated(planned, method, most) for method in shown]
    svg, seconds = animate(scenes, LOOP, (-1.3, -1.0, 3.2, 2.6))
    duration = planned.case.duration
    energies = "; ".join(f"{scene.title}: {scene.label}" for scene in scenes)
    text = TEXT.fill("movies.capture", duration=duration, speed=duration / LOOP, energies=energies)
    return Movie("capture", **text, svg=svg, motion=duration, seconds=seconds)


def _links(arm: Arm) -> tuple[Array, list[float]]:
    """Mount (2,) of an arm and lengths of its links, m."""
    ends = [*(link.position for link in arm.links[1:]), arm.tool_position]
    return np.array(arm.links[0].position[:2]), [float(np.linalg.norm(end)) for end in ends]


def _animated(planned: PlannedCase, method: DualArmMethod, most: float) -> AnimatedRobot:
    """Motion planned by one method; its bar is full at an energy of `most`, J s."""
    course, case = planned.curves[method.key], planned.case
    rows = np.linspace(0, len(course.time) - 1, FRAMES).round().astype(np.int64)
    colors = method.color, SKY if method.color != SKY else ORANGE
    chains = [
        Chain(*_links(arm), course.position[rows, 3 * number : 3 * number + 3], colors[number])
        for number, arm in enumerate(ROBOT.arms)
    ]
    return AnimatedRobot(
        title=method.title,
        base=course.base[rows],
        rotation=np.zeros(FRAMES),
        chains=chains,
        target=np.array(case.centre),
        target_rotation=case.angle + case.spin * (course.time[rows] - course.time[-1]),
        grapples=case.grapples,
        trails=[course.place[rows, arm] for arm in range(2)],
        level=course.energy[rows],
        most=most,
        label=f"C = {planned.plans[method.key].energy:.4f} J s",
    )
