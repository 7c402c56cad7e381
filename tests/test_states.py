"""Recorded states: what is saved is read back, damage is refused, what is drawn was played."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.chunks import task_keywords
from space_envs.evaluation.play.rollout import roll_out
from space_envs.evaluation.play.runner import Played
from space_envs.evaluation.records.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.making import episode_records
from space_envs.evaluation.replay.frames import model_states
from space_envs.evaluation.replay.replay import make_replays, replay_of
from space_envs.evaluation.replay.states import ABOUT, States, concatenate, states_of
from space_envs.registration import ENTRIES, make_task
from space_envs.tasks.base import CaptureTask

SPATIAL = "SpaceCapture/DualArmSpatial-v0"
EMPTY = np.zeros((3, 0))


class Turning:
    """Turns every joint a little."""

    def __init__(self, joints: int) -> None:
        self.joints = joints

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        return np.full((len(observation), self.joints), 0.2), None


def played(env_id: str, variant: str | None = None) -> Played:
    """Two short episodes."""
    keywords = {"difficulty": "easy", "split": "ood"} | ({"variant": variant} if variant else {})
    environment = {"env_id": env_id, "control_mode": "joint_velocity", **keywords}
    rollout = roll_out(
        lambda context: Turning(context.model.nu), environment, "ood", np.array([70, 3]), seed=0
    )
    entry = LeaderboardEntry(EvaluatedTask(env_id, "easy", "ood"), "turning", "joint_velocity")
    records = episode_records(rollout, make_task(env_id, keywords), entry, seed=0)
    return Played(entry, variant, tuple(records), rollout, pace=(1.0,))


def task_of(done: Played) -> CaptureTask:
    return make_task(done.entry.task.env_id, task_keywords(done.entry.task, done.variant))


@pytest.fixture(scope="module")
def one() -> Played:
    return played(SPATIAL)


@pytest.fixture(scope="module")
def states(one: Played) -> States:
    return states_of(one, task_of(one))


def small(**changes: Any) -> States:
    """Made-up states of three episodes of two steps."""
    values: dict[str, Any] = {
        "about": dict.fromkeys(ABOUT, "x") | {"variant": ""},
        "period": 0.1,
        "scene": np.arange(18, dtype=float).reshape(3, 3, 2),
        "attitude": np.zeros((3, 3)),
        "position_error": np.ones((3, 3)),
        "length": np.array([2, 0, 1]),
        "seed": np.array([0, 0, 1]),
        "episode": np.array([0, 1, 0]),
        "index": np.array([5, 6, 7]),
        "outcome": np.array(["captured", "timeout", "policy_error"]),
        "goal": {"mass_scale": np.ones(3)},
    }
    return States(**(values | changes))


def same(one: States, two: States) -> bool:
    arrays = ("scene", "attitude", "position_error", "length", "seed", "episode", "index", "outcome")
    return (
        all(np.array_equal(getattr(one, name), getattr(two, name)) for name in arrays)
        and (one.about, one.period, set(one.goal)) == (two.about, two.period, set(two.goal))
        and all(np.array_equal(value, two.goal[name]) for name, value in one.goal.items())
    )


def test_what_is_saved_is_read_back_and_equal_states_give_equal_bytes(states: States, tmp_path: Path) -> None:
    hostile = replace(states, about={**states.about, "policy": "a\0b\ud800<img src=x>"})
    for number, made in enumerate((states, hostile, small())):
        made.save(tmp_path / f"{number}.npz")
        read = States.load(tmp_path / f"{number}.npz")
        assert same(read, made)
        read.save(tmp_path / "again.npz")
        assert (tmp_path / "again.npz").read_bytes() == (tmp_path / f"{number}.npz").read_bytes()
    assert read.scene.dtype == np.float32 and not read.scene.flags.writeable
    assert read.outcome.dtype.kind == "U"


@pytest.mark.parametrize("env_id", ENTRIES)
def test_states_of_every_id_say_what_was_played(env_id: str, one: Played) -> None:
    done = one if env_id == SPATIAL else played(env_id)
    made = states_of(done, task_of(done))
    assert made.scene.shape == (2, task_of(done).horizon + 1, task_of(done).render_model.nq)
    assert made.task() == task_of(done)
    # The goals are those that the task itself gives, though they were read from the arrays.
    goals, wanted = made.goals(), task_of(done).goals("ood", np.array([70, 3]))
    assert type(goals) is type(wanted)
    for name, value in vars(wanted).items():
        np.testing.assert_array_equal(getattr(goals, name), value)
    for row, record in enumerate(done.records):
        assert made.row(record.seed, record.episode) == row
        assert (made.outcome[row], made.length[row], made.index[row]) == (
            record.outcome,
            record.metrics["steps"],
            record.index,
        )


def test_the_variant_is_kept() -> None:
    done = played("SpaceCapture/SingleArm-v0", variant="physical")
    made = states_of(done, task_of(done))
    assert made.about["variant"] == "physical"
    assert made.task() == task_of(done)
    assert replace(made, about={**made.about, "variant": ""}).task() != task_of(done)


def test_replays_from_states_are_those_from_the_rollout(one: Played, states: States) -> None:
    from_states = make_replays(states.task(), states, one.records)
    from_rollout = make_replays(task_of(one), one.rollout, one.records)
    assert len(from_states) == len(from_rollout) == 2
    for got, wanted in zip(from_states, from_rollout, strict=True):
        assert (got.label, got.seed, got.episode, got.index) == (
            wanted.label,
            wanted.seed,
            wanted.episode,
            wanted.index,
        )
        np.testing.assert_allclose(got.scene, wanted.scene, atol=1e-5)
        np.testing.assert_allclose(got.attitude, wanted.attitude, atol=1e-3)
        np.testing.assert_array_equal(got.time, wanted.time)


def test_drawn_states_are_the_recorded_ones_with_even_motion_between(one: Played, states: States) -> None:
    model = states.task().render_model
    replay = replay_of("", 1, states.task(), states, one.records[1], states.goals())
    data = mujoco.MjData(model)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    drawn = []
    for state in model_states(replay, model, between=2):
        mujoco.mj_setState(model, data, state, kind)
        drawn.append((data.time, data.qpos.copy()))
    assert len(drawn) == 2 * len(replay.time) - 1
    np.testing.assert_allclose([seconds for seconds, _ in drawn[::2]], replay.time, atol=1e-12)
    np.testing.assert_array_equal([qpos for _, qpos in drawn[::2]], replay.scene)
    before, halfway, after = (drawn[k][1] for k in (20, 21, 22))
    np.testing.assert_allclose(halfway[7:21], 0.5 * (before[7:21] + after[7:21]), atol=1e-7)
    np.testing.assert_allclose(halfway[:3], 0.5 * (before[:3] + after[:3]), atol=1e-7)
    # Half of the turn: as far from the one attitude as from the other.
    angles = [abs(float(np.dot(halfway[3:7], other[3:7]))) for other in (before, after)]
    np.testing.assert_allclose(np.linalg.norm(halfway[3:7]), 1.0, atol=1e-6)
    np.testing.assert_allclose(angles[0], angles[1], atol=1e-7)


def test_rows_and_parts(states: States) -> None:
    made = small()
    chosen = made.take([2, 0])
    assert chosen.index.tolist() == [7, 5] and chosen.row(1, 0) == 0
    np.testing.assert_array_equal(chosen.scene, made.scene[[2, 0]])
    assert same(concatenate([made.take([0]), made.take([1, 2])]), made)
    assert len(made.take([]).length) == 0
    with pytest.raises(ConfigurationError, match="episode 4 of seed 1 was not recorded"):
        made.row(1, 4)
    with pytest.raises(ConfigurationError, match="there are none"):
        concatenate([])
    with pytest.raises(ConfigurationError, match="stands twice"):
        concatenate([made, made])
    with pytest.raises(ConfigurationError, match="different about"):
        concatenate([made, states])
    with pytest.raises(ConfigurationError, match="different period"):
        concatenate([made.take([0]), replace(made.take([1]), period=0.2)])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"about": {"env_id": "x"}}, "about must have the texts"),
        ({"about": dict.fromkeys(small().about, 3)}, "about must have the texts"),
        ({"period": 0.0}, "period must be a finite positive number"),
        ({"period": np.nan}, "period must be a finite positive number"),
        ({"scene": np.full((3, 3, 2), np.nan)}, "scene holds NaN"),
        ({"scene": np.full((3, 3, 2), 1e300)}, "scene holds NaN or infinity"),
        ({"scene": np.zeros((3, 3))}, "scene must have shape"),
        ({"scene": np.zeros((3, 0, 2)), "attitude": EMPTY, "position_error": EMPTY}, "length must lie in"),
        ({"attitude": np.zeros((3, 4))}, r"attitude must have shape \(3, 3\), got \(3, 4\)"),
        ({"length": np.array([2, 0, 3])}, r"length must lie in 0..2"),
        ({"length": np.array([2, 0, -1])}, r"length must lie in 0..2"),
        ({"length": np.array([2.0, 0.0, 1.0])}, "length must be of int64"),
        ({"seed": np.array([0, 0])}, "seed must have shape"),
        ({"index": np.array([-1, 0, 0])}, "index must not be negative"),
        ({"episode": np.array([0, 0, 0])}, "stands twice"),
        ({"outcome": np.array([1, 2, 3])}, "outcome must be of"),
        ({"outcome": np.array(["a", "b", None], dtype=object)}, "outcome must be of"),
        ({"goal": {"mass_scale": np.ones(2)}}, "goal_mass_scale must hold numbers for 3 episodes"),
        ({"goal": {"mass_scale": np.array(["a", "b", "c"])}}, "goal_mass_scale must hold numbers"),
    ],
)  # fmt: skip
def test_bad_states_are_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        small(**changes)


def saved(path: Path, states: States, **changes: Any) -> Path:
    """Saved states with arrays of the file replaced, or removed where None."""
    states.save(path)
    with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files} | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {"scene": None},
        {"about": None},
        {"about": np.array("{")},
        {"about": np.array(json.dumps([1]))},
        {"period": np.array("x")},
        {"outcome": np.array([{"an": "object"}] * 3, dtype=object)},
        {"more": np.zeros(3)},
        {"length": np.array([9, 9, 9])},
    ],
)
def test_damaged_files_name_themselves(changes: dict[str, Any], tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npz", small(), **changes)
    with pytest.raises(ConfigurationError, match=r"a\.npz: not a file of states"):
        States.load(path)


def test_cut_and_missing_files_name_themselves(tmp_path: Path) -> None:
    small().save(tmp_path / "a.npz")
    whole = (tmp_path / "a.npz").read_bytes()
    for number, content in enumerate((b"", b"no archive", whole[: len(whole) // 2], whole[:-30])):
        (tmp_path / f"{number}.npz").write_bytes(content)
        with pytest.raises(ConfigurationError, match=rf"{number}\.npz: not a file of states"):
            States.load(tmp_path / f"{number}.npz")
    with pytest.raises(ConfigurationError, match=r"none\.npz: not a file of states"):
        States.load(tmp_path / "none.npz")


def test_states_of_another_model_or_goal_are_refused(states: States) -> None:
    with pytest.raises(ConfigurationError, match="has 28 coordinates, these have 27"):
        replace(states, scene=states.scene[..., :27]).task()
    with pytest.raises(ConfigurationError, match="Did you mean 'SpaceCapture/DualArmSpatial-v0'"):
        replace(states, about={**states.about, "env_id": "SpaceCapture/DualArmSpatial-v1"}).task()
    with pytest.raises(ConfigurationError, match="goals have"):
        replace(states, goal={}).goals()


def test_records_with_an_episode_twice_are_refused(one: Played) -> None:
    twice = tuple(replace(record, episode=0, checksum="") for record in one.records)
    with pytest.raises(ConfigurationError, match="stands twice"):
        states_of(replace(one, records=twice), task_of(one))
