"""Makes libraries of optimal demonstrations: in parallel, resumable, each goal improved from those beside.

python -m agents.demonstrations.optimal --jobs 2 --output demonstrations/optimal
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from agents.planners.single_arm.library import NAMES, Library, library_name
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.weights.promp_optimal import VIOLATION_TOLERANCE, Planner, predicted_costs
from agents.planners.single_arm.weights.sqp import GOAL_TOLERANCE, minimise
from agents.planners.common.plans import Limits
from space_envs.checks import count, flag
from space_envs.system.command_line import AppendValues, Parser, exit_status
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.system.provenance import commit, machine, versions
from space_envs.system.files import atomic_write_text
from space_envs.robots.parameters import SINGLE_ARM
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.system.threads import on_one_thread

COUNTS = {"easy": 120, "medium": 900, "hard": 180}  # goals of the train split
ROUNDS = 3  # of handing solutions to the goals beside
BESIDE = 16  # goals whose solutions are looked at in a round
TRIED = 4  # of them, that are improved
GAIN = 0.99  # of its cost, that a solution beside must promise to be tried
CHUNK = 30  # goals a file of partial results
STARTS = 3  # around the motion that is easiest to find, in the first round
SPREAD = 0.1  # of them, in coordinates
ITERATIONS = 40  # of a start in the first round
FINE = 1e-4  # relative gain of an iteration below which a demonstration is done, in the last round


@dataclass(frozen=True)
class Recipe:
    """What determines a library.

    Attributes:
        keep_attitude: whether motions end with the base's first attitude. limited: whether they keep the
            model's limits. seed: of the starts.
    """

    keep_attitude: bool
    limited: bool
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("keep_attitude", "limited"):
            flag(name, getattr(self, name))
        count("seed", self.seed, 2**63)

    @property
    def name(self) -> str:
        """Of the library's file."""
        return library_name(self.keep_attitude, self.limited)


def model_limits() -> Limits:
    """Limits of the single arm's model, as the environment's drives have them."""
    position = SingleArmTask().robot.range
    return Limits(position, SINGLE_ARM.rate_limit, SINGLE_ARM.acceleration_limit, SINGLE_ARM.torque_limit)


def goals(counts: dict[str, int] = COUNTS) -> tuple[Array, Array]:
    """Positions (L, 3) m and quaternions (L, 4) of train goals."""
    position, quaternion = [], []
    for difficulty, many in counts.items():
        drawn = SingleArmTask(difficulty=difficulty).goals("train", np.arange(many))
        position.append(drawn.position)
        quaternion.append(drawn.quaternion)
    return np.concatenate(position), np.concatenate(quaternion)


def generate(
    output: str | Path,
    recipe: Recipe,
    counts: dict[str, int] = COUNTS,
    jobs: int = 1,
    progress: bool = False,
) -> Library:
    """Make a library into the folder `output`; what is there of the same recipe is kept.

    The result does not depend on the number of jobs nor on interruptions.

    Raises:
        ConfigurationError: if jobs is not positive, or a part is of other goals.
        StorageError: if a part is damaged.
    """
    if jobs < 1:
        raise ConfigurationError(f"jobs must be at least 1, got {jobs}")
    position, quaternion = goals(counts)
    size = len(position)
    folder = Path(output) / Path(recipe.name).stem
    library = None
    with tqdm(
        total=size * (ROUNDS + 1), unit="goal", desc=Path(recipe.name).stem, disable=not progress
    ) as bar:
        for number in range(ROUNDS + 1):
            parts = {
                folder / f"{number}-{first:05d}.npz": np.arange(first, min(first + CHUNK, size))
                for first in range(0, size, CHUNK)
            }
            missing = [path for path in parts if not path.exists()]
            bar.update(size - sum(len(parts[path]) for path in missing))
            work = (
                delayed(_part)(
                    path, recipe, position[rows], quaternion[rows], rows, library, number == ROUNDS
                )
                for path in missing
                for rows in [parts[path]]
            )
            for made in Parallel(n_jobs=jobs, return_as="generator_unordered")(work):
                bar.update(made)
            library = _merged([Library.load(path) for path in parts])
            if not np.array_equal(library.position, position):
                raise ConfigurationError(f"{folder} holds other goals; take another folder")
    whole = _merged([Library.load(path) for path in parts])
    kept = whole.rows(np.isfinite(whole.cost))
    kept = replace(kept, coordinates=kept.coordinates.astype(np.float32))
    path = Path(output) / recipe.name
    kept.save(path)
    made = {
        "command": "python -m agents.demonstrations.optimal",
        "seed": recipe.seed,
        "train goals": counts,
        "motions": len(kept.cost),
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }
    atomic_write_text(path.with_suffix(".json"), json.dumps(made, indent=2) + "\n")
    return kept


def _merged(parts: Sequence[Library]) -> Library:
    return Library(*[np.concatenate([getattr(p, name) for p in parts]) for name in NAMES])


def _part(
    path: Path,
    recipe: Recipe,
    position: Array,
    quaternion: Array,
    numbers: Array,
    before: Library | None,
    last: bool,
) -> int:
    """One file of a round; returns the number of its goals."""
    on_one_thread()  # several threads of BLAS give other bits
    robot = SingleArmTask().robot
    planner = Planner(robot, model_limits() if recipe.limited else Limits())
    rows = []
    for number, place, turn in zip(numbers, position, quaternion, strict=True):
        reach = Reach(robot.home, place, turn, keep_attitude=recipe.keep_attitude).checked(robot)
        if before is None:
            rows.append(_first(planner, reach, np.random.default_rng([recipe.seed, number])))
        else:
            rows.append(_improved(planner, reach, before, int(number), last))
    coordinates, cost, attempts = (np.array(column) for column in zip(*rows, strict=True))
    Library(position, quaternion, coordinates, cost, attempts).save(path)
    return len(numbers)


def _first(planner: Planner, reach: Reach, rng: np.random.Generator) -> tuple[Array, float, float]:
    """The best of several starts: coordinates, cost (infinite if no start led to the goal), their number."""
    space, bounds, rows = planner.setting(reach)
    rest = np.zeros((len(reach.start), space.free))
    # To first order an arm at rest cannot turn its base back: those that shall start around the free motion.
    centre = minimise(space, bounds, rest, False, rows).y if reach.keep_attitude else rest
    around = centre + SPREAD * rng.standard_normal((STARTS, *rest.shape))
    begins = [*around] if reach.keep_attitude else [rest, *around]
    y, cost = rest, np.inf
    for begin in begins:
        found = minimise(space, bounds, begin, reach.keep_attitude, rows, iterations=ITERATIONS)
        if found.goal_error < GOAL_TOLERANCE and found.violation < VIOLATION_TOLERANCE and found.cost < cost:
            y, cost = found.y, found.cost
    return y, cost, float(len(begins))


def _improved(
    planner: Planner, reach: Reach, before: Library, number: int, last: bool
) -> tuple[Array, float, float]:
    """The best so far, or what comes of the solutions beside that promise to be cheaper."""
    space, bounds, rows = planner.setting(reach)
    y, cost = before.coordinates[number], float(before.cost[number])
    beside = before.order(reach.position, reach.quaternion)
    beside = beside[(beside != number) & np.isfinite(before.cost[beside])][:BESIDE]
    starts = before.coordinates[beside]
    promise = predicted_costs(space, starts, reach.keep_attitude)
    order = np.argsort(promise, kind="stable")[:TRIED]
    chosen = starts[order[promise[order] < GAIN * cost]]
    for begin in chosen:
        found = minimise(space, bounds, begin, reach.keep_attitude, rows)
        if found.goal_error < GOAL_TOLERANCE and found.violation < VIOLATION_TOLERANCE and found.cost < cost:
            y, cost = found.y, found.cost
    if last and np.isfinite(cost):
        found = minimise(space, bounds, y, reach.keep_attitude, rows, tolerance=FINE)
        if found.goal_error < GOAL_TOLERANCE and found.violation < VIOLATION_TOLERANCE and found.cost < cost:
            y, cost = found.y, found.cost
    return y, cost, float(before.attempts[number] + len(chosen))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    parser = Parser(
        prog="python -m agents.demonstrations.optimal", description="Make the libraries of optimal motions."
    )
    parser.add_argument(
        "--output", type=Path, default=Path("demonstrations/optimal"), help="default %(default)s"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="default %(default)s")
    parser.add_argument(
        "--setting",
        choices=("free", "kept"),
        action=AppendValues,
        nargs="+",
        default=["free", "kept"],
        help="base attitude at the end (default both)",
    )
    parser.add_argument(
        "--limits",
        choices=("limited", "wide"),
        action=AppendValues,
        nargs="+",
        default=["limited", "wide"],
        help="the model's limits, or none (default both)",
    )
    options = parser.parse_args(arguments)
    try:
        for limits in options.limits:
            for setting in options.setting:
                recipe = Recipe(setting == "kept", limits == "limited", options.seed)
                made = generate(options.output, recipe, jobs=options.jobs, progress=True)
                cost = f"median eq. 20 cost {1e4 * np.median(made.cost):.2f} cm^2/s"
                print(f"{options.output / recipe.name}: {len(made.cost)} motions, {cost}")
    except KeyboardInterrupt:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 130
    except (SpaceEnvsError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(exit_status("python -m agents.demonstrations.optimal", main))
