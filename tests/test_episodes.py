"""Recorded episodes: what is saved is read back, damage is refused, what is drawn was played."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from evaluated_tasks import evaluated
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.play.episode_file import (
    compact,
    from_arrays,
    load_episodes,
    save_episodes,
    to_arrays,
)
from space_envs.evaluation.play.episodes import EpisodeBatch, concatenate
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.rollout import Rollout
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.making import episode_records
from space_envs.evaluation.replay.frames import model_states
from space_envs.evaluation.replay.replay import make_replays, replay_of
from space_envs.registration import ENTRIES, make_task
from space_envs.robots.zoo import find_robot

SPATIAL = "SpaceCapture/DualArmSpatial-v0"
EMPTY = np.zeros((3, 0))
ARRAYS = ("scene", "base_pose", "attitude", "position_error", "orientation_error")
LABELS = ("length", "seed", "episode", "index", "outcome")


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


def played(env_id: str, **keywords: str) -> Rollout:
    """Two short episodes."""
    task, robot = evaluated(env_id, "easy", "ood", **keywords)
    environment = {"env_id": env_id, "control_mode": "joint_velocity", **task.keywords(robot)}
    return roll_out(
        lambda context: Turning(context.model.nu), environment, "ood", np.array([70, 3]), 0, policy="turning"
    )


def records_of(episodes: Rollout) -> list[EpisodeRecord]:
    return episode_records(episodes, episodes.task(), episodes.entry, seed=0)


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    return played(SPATIAL)


@pytest.fixture(scope="module")
def stored(rollout: Rollout) -> EpisodeBatch:
    return compact(rollout)


def small(**changes: Any) -> EpisodeBatch:
    """Made-up episodes of two steps, three of them."""
    task, robot = evaluated(SPATIAL)
    values: dict[str, Any] = {
        "entry": LeaderboardEntry(task, "x", "x"),
        "robot": robot,
        "period": 0.1,
        "scene": np.arange(18, dtype=float).reshape(3, 3, 2),
        "base_pose": np.arange(63, dtype=float).reshape(3, 3, 7),
        "attitude": np.zeros((3, 3)),
        "position_error": np.ones((3, 3)),
        "orientation_error": np.ones((3, 3)),
        "length": np.array([2, 0, 1]),
        "seed": np.array([0, 0, 1]),
        "episode": np.array([0, 1, 0]),
        "index": np.array([5, 6, 7]),
        "outcome": np.array(["captured", "timeout", "policy_error"]),
        "goal": {"mass_scale": np.ones(3)},
    }
    return EpisodeBatch(**(values | changes))


def same(one: EpisodeBatch, two: EpisodeBatch) -> bool:
    return (
        all(np.array_equal(getattr(one, name), getattr(two, name)) for name in (*ARRAYS, *LABELS))
        and (one.entry, one.robot, one.period) == (two.entry, two.robot, two.period)
        and set(one.goal) == set(two.goal)
        and all(np.array_equal(value, two.goal[name]) for name, value in one.goal.items())
    )


def test_what_is_saved_is_read_back_and_equal_episodes_give_equal_bytes(
    stored: EpisodeBatch, tmp_path: Path
) -> None:
    hostile = replace(stored, entry=replace(stored.entry, policy="a\0b\ud800<img src=x>"))
    for number, made in enumerate((stored, hostile, small())):
        save_episodes(tmp_path / f"{number}.npz", made)
        read = load_episodes(tmp_path / f"{number}.npz")
        assert same(read, made)
        save_episodes(tmp_path / "again.npz", read)
        assert (tmp_path / "again.npz").read_bytes() == (tmp_path / f"{number}.npz").read_bytes()
    assert read.scene.dtype == np.float32 and not read.scene.flags.writeable
    assert read.outcome.dtype.kind == "U"


@pytest.mark.parametrize("env_id", ENTRIES)
def test_episodes_of_every_id_say_what_was_played(env_id: str, rollout: Rollout) -> None:
    done = rollout if env_id == SPATIAL else played(env_id)
    task = make_task(env_id, {"difficulty": "easy", "split": "ood"})
    assert done.entry == LeaderboardEntry(evaluated(env_id, "easy", "ood")[0], "turning", "joint_velocity")
    assert done.scene.shape == (2, task.horizon + 1, task.render_model.nq)
    assert done.task() == task
    np.testing.assert_array_equal(done.qpos[..., 7:], done.joint_position)
    # The rotation of the base is that by which the task itself judges the attitude.
    rotation, translation = done.base_displacement()
    np.testing.assert_allclose(np.linalg.norm(rotation, axis=-1), done.attitude, atol=1e-5)
    np.testing.assert_array_equal(translation[:, 0], 0.0)
    assert np.abs(translation[:, 10]).max() > 1e-6
    # The goals are those that the task itself gives, though they were read from the arrays.
    goals, wanted = done.goals, task.goals("ood", np.array([70, 3]))
    assert type(goals) is type(wanted)
    for name, value in vars(wanted).items():
        np.testing.assert_array_equal(getattr(goals, name), value)
    for row, record in enumerate(records_of(done)):
        assert done.row(record.seed, record.episode) == row
        assert (done.outcome[row], done.length[row], done.index[row]) == (
            record.outcome,
            record.metrics["steps"],
            record.index,
        )


def test_the_robot_is_kept() -> None:
    made = played("SpaceCapture/SingleArm-v0", variant="physical")
    assert made.entry.task.robot == made.robot.title == "shyam2020/physical"
    assert made.task() == make_task(
        "SpaceCapture/SingleArm-v0", {"difficulty": "easy", "split": "ood", "variant": "physical"}
    )
    with pytest.raises(ConfigurationError, match="digest"):
        from_arrays(to_arrays(replace(made, robot=find_robot("shyam2020"))))


def test_replays_of_stored_episodes_are_those_of_the_rollout(rollout: Rollout, stored: EpisodeBatch) -> None:
    records = records_of(rollout)
    from_stored = make_replays(stored.task(), stored, records)
    from_rollout = make_replays(rollout.task(), rollout, records)
    assert len(from_stored) == len(from_rollout) == 2
    for got, wanted in zip(from_stored, from_rollout, strict=True):
        assert (got.label, got.seed, got.episode, got.index) == (
            wanted.label,
            wanted.seed,
            wanted.episode,
            wanted.index,
        )
        np.testing.assert_allclose(got.scene, wanted.scene, atol=1e-5)
        np.testing.assert_allclose(got.attitude, wanted.attitude, atol=1e-3)
        np.testing.assert_array_equal(got.time, wanted.time)


def test_drawn_states_are_the_recorded_ones_with_even_motion_between(
    rollout: Rollout, stored: EpisodeBatch
) -> None:
    model = stored.task().render_model
    replay = replay_of("", 1, stored.task(), stored, records_of(rollout)[1])
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
    # Half of the rotation: as far from the one attitude as from the other.
    angles = [abs(float(np.dot(halfway[3:7], other[3:7]))) for other in (before, after)]
    np.testing.assert_allclose(np.linalg.norm(halfway[3:7]), 1.0, atol=1e-6)
    np.testing.assert_allclose(angles[0], angles[1], atol=1e-7)


def test_rows_and_parts(rollout: Rollout) -> None:
    made = small()
    chosen = made.take([2, 0])
    assert chosen.index.tolist() == [7, 5] and chosen.row(1, 0) == 0 and len(chosen) == 2
    np.testing.assert_array_equal(chosen.scene, made.scene[[2, 0]])
    assert same(concatenate([made.take([0]), made.take([1, 2])]), made)
    assert len(made.take([])) == 0
    whole = concatenate([rollout.take([0]), rollout.take([1])])
    np.testing.assert_array_equal(whole.torque, rollout.torque)
    assert whole.reason.tolist() == rollout.reason.tolist()
    with pytest.raises(ConfigurationError, match="episode 4 of seed 1 was not recorded"):
        made.row(1, 4)
    with pytest.raises(ConfigurationError, match="there are none"):
        concatenate([])
    with pytest.raises(ConfigurationError, match="stands twice"):
        concatenate([made, made])
    with pytest.raises(ConfigurationError, match="different entry"):
        concatenate([made, compact(rollout)])
    with pytest.raises(ConfigurationError, match="different period"):
        concatenate([made.take([0]), replace(made.take([1]), period=0.2)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"period": 0.0}, "period must be a finite positive number"),
        ({"period": np.nan}, "period must be a finite positive number"),
        ({"scene": np.full((3, 3, 2), np.nan)}, "scene holds NaN"),
        ({"scene": np.full((3, 3, 2), 1e300)}, "scene holds NaN, infinity or numbers beyond 32 bits"),
        ({"scene": np.zeros((3, 3))}, "scene must have shape"),
        ({"scene": np.zeros((3, 0, 2)), "base_pose": np.zeros((3, 0, 7)),
          **dict.fromkeys(("attitude", "position_error", "orientation_error"), EMPTY)}, "length must lie in"),
        ({"base_pose": np.zeros((3, 3, 6))}, r"base_pose must have shape \(3, 3, 7\), got \(3, 3, 6\)"),
        ({"attitude": np.zeros((3, 4))}, r"attitude must have shape \(3, 3\), got \(3, 4\)"),
        ({"length": np.array([2, 0, 3])}, r"length must lie in 0..2"),
        ({"length": np.array([2, 0, -1])}, r"length must lie in 0..2"),
        ({"length": np.array([2.0, 0.0, 1.0])}, "length must hold whole numbers"),
        ({"seed": np.array([0, 0])}, "seed must have shape"),
        ({"index": np.array([-1, 0, 0])}, "index must not be negative"),
        ({"episode": np.array([0, 0, 0])}, "stands twice"),
        ({"outcome": np.array([1, 2, 3])}, "outcome must hold texts"),
        ({"outcome": np.array(["a", "b", None], dtype=object)}, "outcome must hold texts"),
        ({"goal": {"mass_scale": np.ones(2)}}, "goal mass_scale must hold numbers for 3 episodes"),
        ({"goal": {"mass_scale": np.array(["a", "b", "c"])}}, "goal mass_scale must hold numbers"),
    ],
)  # fmt: skip
def test_bad_episodes_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        small(**changes)


def test_damaged_files_name_themselves(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_episodes(path, small())
    whole = path.read_bytes()
    with np.load(io.BytesIO(whole), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    about = json.loads(str(arrays["about"]))
    for changes in (
        {"scene": None},
        {"about": None},
        {"about": np.array("{")},
        {"about": np.array(json.dumps([1]))},
        {"about": np.array(json.dumps({**about, "policy": 3}))},
        {"about": np.array(json.dumps({**about, "model": 3}))},
        {"about": np.array(json.dumps({**about, "model": {**about["model"], "arms": []}}))},
        {"about": np.array(json.dumps({**about, "task": {"env_id": "x"}}))},
        {"period": np.array("x")},
        {"outcome": np.array([{"an": "object"}] * 3, dtype=object)},
        {"more": np.zeros(3)},
        {"length": np.array([9, 9, 9])},
    ):
        altered: dict[str, Any] = {k: v for k, v in (arrays | changes).items() if v is not None}
        np.savez(path, **altered)
        with pytest.raises(ConfigurationError, match=r"a\.npz: not a file of episodes"):
            load_episodes(path)
    for content in (b"", b"no archive", whole[: len(whole) // 2], whole[:-30]):
        path.write_bytes(content)
        with pytest.raises(ConfigurationError, match=r"a\.npz: not a file of episodes"):
            load_episodes(path)
    with pytest.raises(ConfigurationError, match=r"none\.npz: not a file of episodes"):
        load_episodes(tmp_path / "none.npz")


def test_episodes_of_another_model_or_goal_are_refused(stored: EpisodeBatch) -> None:
    with pytest.raises(ConfigurationError, match="has 28 coordinates, these have 27"):
        replace(stored, scene=stored.scene[..., :27]).task()
    unknown = replace(stored.entry.task, env_id="SpaceCapture/DualArmSpatial-v1")
    with pytest.raises(ConfigurationError, match="Did you mean 'SpaceCapture/DualArmSpatial-v0'"):
        replace(stored, entry=replace(stored.entry, task=unknown)).task()
    with pytest.raises(ConfigurationError, match="goals have"):
        _ = replace(stored, goal={}).goals
