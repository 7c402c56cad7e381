"""The demonstrations of sec. IV on the page: the workspace, the variations, and what is learned from them."""

import numpy as np
from matplotlib.axes import Axes

from agents.demonstrations.prior import fit_prior
from agents.demonstrations.variations import BANDS
from agents.policies.single_arm.promp import ConditionedPrior
from reproduce.compare import short
from reproduce.page.blocks import Table
from reproduce.page.drawing import AXES, place_axes, shares
from reproduce.page.figures import Draw, Figure, figure
from reproduce.shyam2020.cases import GoalCase, context
from reproduce.shyam2020.demonstrated import PAPER, DemonstratedWorkspace, bends, distance_to_demonstrated
from reproduce.shyam2020.page.text import TEXT
from reproduce.shyam2020.sampling import draw_samples
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, ORANGE, VERMILION
from space_envs.evaluation.report.drawing.panel import INK

SHOWN = 45  # paths drawn of each variation
EVERY = 4  # samples of a path between those that are drawn
NAMES: dict[str, str] = TEXT.fill("variations")
COLORS = {"cost_matrices": BLUE, "noise": GREEN, "task": VERMILION, "joint": ORANGE}


def workspace(found: DemonstratedWorkspace) -> Figure:
    """Paths of the end-effector under all variations, from two sides, and distances of test goals."""
    distance = 100 * np.sort(distance_to_demonstrated(found))
    views = ((1, 2), (0, 1))
    text = TEXT.fill(
        "figures.workspace",
        paths=SHOWN,
        goals=len(found.goals),
        count=len(found.made[PAPER].kind),
        spans=[_spans(found, view) for view in views],
        half=np.median(distance),
        most=np.quantile(distance, 0.9),
    )
    draws = (*(_paths(found, *view) for view in views), lambda axes: _draw_distances(axes, distance))
    return figure("workspace", text, draws, height=3.4)


def _spans(found: DemonstratedWorkspace, axes: tuple[int, int]) -> str:
    """Extent of the paths along two axes, in words."""
    low, high = (np.quantile(found.end_effector[PAPER], q, axis=(0, 1)) for q in (0.0, 1.0))
    return " and ".join(f"{low[a]:.1f} to {high[a]:.1f} m along {AXES[a]}" for a in axes)


def _paths(found: DemonstratedWorkspace, first: int, second: int) -> Draw:
    """Function that draws the paths of every variation in the plane of two axes."""

    def draw(axes: Axes) -> None:
        half = context().robot.satellite.box[0]
        axes.plot(*half * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]]), color=INK, lw=0.9)
        goals = found.goals[:, [first, second]]
        axes.plot(*goals.T, ".", color=INK, ms=2, alpha=0.35, label="test goals")
        for name, label in NAMES.items():
            bands, rows = found.rows(name)
            for row in rows[:SHOWN]:
                path = found.end_effector[bands][row, ::EVERY, [first, second]]
                axes.plot(*path, color=COLORS[name], lw=0.6, alpha=0.55)
            axes.plot([], [], color=COLORS[name], lw=1.6, label=label)
        place_axes(axes, (f"{AXES[first]} [m]", f"{AXES[second]} [m]"))

    return draw


def _draw_distances(axes: Axes, distance: Array) -> None:
    axes.step(distance, shares(distance), color=VERMILION, lw=1.9)
    axes.set(xlabel="from the nearest demonstrated goal [cm]", ylabel="test goals up to here [%]")
    axes.set_xlim(left=0)
    axes.grid()
    for name, label in NAMES.items():  # the names of the colors in the other panels
        axes.plot([], [], color=COLORS[name], lw=1.6, label=label)
    axes.legend(fontsize=7, loc="lower right")


def variations(found: DemonstratedWorkspace) -> Table:
    """Bends, costs and rejections of the demonstrations of each variation."""
    rows = []
    for name, label in NAMES.items():
        bands, of = found.rows(name)
        made = found.made[bands]
        bent = bends(made)[of]
        rows.append(
            (
                label,
                str(len(of)),
                short(100 * float(np.median(bent))),
                short(100 * float(np.quantile(bent, 0.9))),
                short(1e4 * float(np.median(made.cost[of]))),
                str(int((made.attempt[of] > 0).sum())),
            )
        )
    return Table(**TEXT.fill("tables.variations"), rows=rows, colors=tuple(COLORS[name] for name in NAMES))


def learned(found: DemonstratedWorkspace, case: GoalCase, seed: int) -> Table:
    """Samples of the priors learned from each set of demonstrations, on one goal."""
    rows = []
    for bands in (PAPER, *(each for each in BANDS if each != PAPER)):
        made = found.made[bands]
        drawn = draw_samples(case, seed, at=ConditionedPrior(fit_prior(made), made.time))
        label = f"{len(made.kind)} demonstrations, {NAMES[bands]}"
        if drawn is None:
            rows.append((label, *["-"] * 4))
            continue
        usable = drawn.cost[drawn.within]
        rows.append(
            (
                label,
                short(1e4 * float(np.median(drawn.cost))),
                short(1e4 * float(usable.min())) if usable.size else "-",
                str(int(drawn.within.sum())),
                short(float(np.rad2deg(np.median(drawn.end_attitude)))),
            )
        )
    return Table(**TEXT.fill("tables.learned"), rows=rows)
