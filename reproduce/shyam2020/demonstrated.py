"""The demonstrations of sec. IV: the workspace that they cover, and what their variations do."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import KDTree

from agents.demonstrations.controller import Demonstrations, demonstrate
from agents.demonstrations.elastic_bands import end_effector_path
from agents.demonstrations.prior import fit_prior
from agents.demonstrations.storage import COUNT
from agents.demonstrations.variations import BANDS, KINDS, DemonstratorConfig
from agents.policies.single_arm.promp import ConditionedPrior
from reproduce.figures import Figure, Sketch, figure
from reproduce.page import Table
from reproduce.shyam2020.cases import DIFFICULTY, Case, context
from reproduce.shyam2020.sampling import draw
from reproduce.shyam2020.tables import short
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.rotations import Array, rotate
from space_envs.evaluation.report.drawing import INK
from space_envs.evaluation.report.figures import BLUE, GREEN, ORANGE, VERMILION
from space_envs.robots.parameters import SINGLE_ARM
from space_envs.tasks.single_arm import SPLIT_SIZE, SingleArmTask

QUICK = 60  # demonstrations of a quick run
SHOWN = 45  # paths drawn of each variation
EVERY = 4  # samples of a path between those that are drawn
PAPER = "task"  # bands of the paper; the shipped prior has the others
NAMES = {
    "cost_matrices": "cost matrices (1)",
    "noise": "noise in the constraint (3)",
    "task": "elastic bands in task space (2)",
    "joint": "elastic bands in joint space, ours",
}
COLOURS = {"cost_matrices": BLUE, "noise": GREEN, "task": VERMILION, "joint": ORANGE}


@dataclass(frozen=True, eq=False)
class Covered:
    """D demonstrations of each kind of elastic bands.

    Attributes:
        made: by bands, task and joint. tip: (D, T, 3) m of the end-effector, inertial frame, likewise.
        goals: (K, 3) m, of the test split.
    """

    made: Mapping[str, Demonstrations]
    tip: Mapping[str, Array]
    goals: Array

    def rows(self, name: str) -> tuple[str, np.ndarray]:
        """Bands, and the rows of their demonstrations, of a variation in NAMES."""
        bands = name if name in BANDS else PAPER
        kind = "elastic_band" if name in BANDS else name
        return bands, np.flatnonzero(self.made[bands].kind == KINDS.index(kind))


def cover(seed: int, count: int = COUNT) -> Covered:
    """Make demonstrations as the shipped prior's were, with both kinds of elastic bands.

    Raises:
        PlanningError: if one cannot be drawn.
    """
    arm = context().arm
    made = {bands: demonstrate(replace(DemonstratorConfig(), bands=bands), seed, 0, count) for bands in BANDS}
    tips = {}
    for bands, each in made.items():
        base, attitude = roll_out_base(arm, each.position, each.velocity, float(each.time[1]))
        tips[bands] = base + rotate(attitude, end_effector_path(arm, each.position))
    goals = SingleArmTask(difficulty=DIFFICULTY).goals("test", np.arange(SPLIT_SIZE["test"])).position
    return Covered(made, tips, goals)


def distance_to_demonstrated(found: Covered) -> Array:
    """Distances (K,) m of test goals from the nearest end of a demonstration with the paper's variations."""
    return KDTree(found.tip[PAPER][:, -1]).query(found.goals)[0]


def workspace(found: Covered) -> Figure:
    """Paths of the end-effector under all variations, from two sides, and how near test goals are."""

    def view(first: int, second: int) -> Sketch:
        def draw(axes: Axes) -> None:
            half = 0.5 * SINGLE_ARM.satellite_side
            axes.plot(*half * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]]), color=INK, lw=0.9)
            axes.plot(
                *found.goals[:, [first, second]].T, ".", color=INK, ms=2, alpha=0.35, label="test goals"
            )
            for name, label in NAMES.items():
                bands, rows = found.rows(name)
                colour = COLOURS[name]
                for row in rows[:SHOWN]:
                    axes.plot(
                        *found.tip[bands][row, ::EVERY, [first, second]], color=colour, lw=0.6, alpha=0.55
                    )
                axes.plot([], [], color=colour, lw=1.6, label=label)
            axes.set_aspect("equal")
            axes.set(xlabel=f"{'xyz'[first]} [m]", ylabel=f"{'xyz'[second]} [m]")

        low, high = (np.quantile(found.tip[PAPER], q, axis=(0, 1)) for q in (0.0, 1.0))
        spans = " and ".join(f"{low[a]:.1f} to {high[a]:.1f} m along {'xyz'[a]}" for a in (first, second))
        return Sketch(draw, f"End-effector paths of the demonstrations: {spans}.")

    distance = 100 * np.sort(distance_to_demonstrated(found))

    def nearness(axes: Axes) -> None:
        share = 100 * (np.arange(distance.size) + 1) / distance.size
        axes.step(distance, share, color=VERMILION, lw=1.9)
        axes.set(xlabel="from the nearest demonstrated goal [cm]", ylabel="test goals up to here [%]")
        axes.set_xlim(left=0)
        axes.grid()
        for name, label in NAMES.items():  # the names of the colours in the other panels
            axes.plot([], [], color=COLOURS[name], lw=1.6, label=label)
        axes.legend(fontsize=7, loc="lower right")

    count = len(found.made[PAPER].kind)
    return figure(
        "workspace",
        "The workspace that the demonstrations cover",
        f"Inertial paths of the end-effector of the floating robot, up to {SHOWN} of each variation of sec. "
        f"IV; square: the satellite; dots: the {len(found.goals)} goals of the test split, none of which was "
        f"demonstrated. Right: how far those are from the nearest of the goals of {count} demonstrations.",
        (
            view(1, 2),
            view(0, 1),
            Sketch(
                nearness,
                f"Half of the test goals lie within {np.median(distance):.0f} cm of a demonstrated one, 90 % "
                f"within {np.quantile(distance, 0.9):.0f} cm.",
            ),
        ),
        height=3.4,
    )


def variations(found: Covered) -> Table:
    """What each variation does to the demonstrations."""
    rows = []
    for name, label in NAMES.items():
        bands, of = found.rows(name)
        made = found.made[bands]
        bent = _bent(made)[of]
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
    return Table(
        "What the variations do",
        ("variation", "demonstrations", "bend, median [cm]", "90 %", "eq. 20 [cm²/s]", "drawn again"),
        tuple(rows),
        "Bend: largest distance of the end-effector, in the base frame, from where it would be on the "
        "straight joint motion to the same posture, equally far along. The paper's artificial obstacles are "
        "read as spheres between the end-effector's two points. The shipped prior was learned from bands in "
        "joint space, another variation, and keeps them: with others the scores of all its policies would "
        "change.",
        colours=tuple(COLOURS[name] for name in NAMES),
    )


def _bent(made: Demonstrations) -> Array:
    """Largest distances (D,) m of the end-effector from its path along the straight joint motion."""
    arm = context().arm
    whole = made.position[:, -1:] - made.position[:, :1]
    along = ((made.position - made.position[:, :1]) * whole).sum(axis=2) / (whole * whole).sum(axis=2)
    straight = made.position[:, :1] + along[..., None] * whole
    apart = end_effector_path(arm, made.position) - end_effector_path(arm, straight)
    return np.linalg.norm(apart, axis=2).max(axis=1)


def learned(found: Covered, case: Case, seed: int) -> Table:
    """What the algorithm makes of each set of demonstrations, on one goal."""
    rows = []
    for bands in (PAPER, *(each for each in BANDS if each != PAPER)):
        made = found.made[bands]
        drawn = draw(case, seed, at=ConditionedPrior(fit_prior(made), made.time))
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
    return Table(
        "Learned from either kind of elastic bands",
        (
            "prior",
            "eq. 20 of samples, median [cm²/s]",
            "least within the limits",
            "within the limits, of 100",
            "end attitude, median [deg]",
        ),
        tuple(rows),
        "Page's own goal, 100 samples of the ProMP fitted to the demonstrations above and conditioned on "
        "start and goal. The other two variations are the same in both.",
    )
