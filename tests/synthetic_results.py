"""A made-up but plausible evaluation, and a real short one, for the tests of statistics and report."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np
from evaluated_tasks import evaluated

from agents.policies.resolve import resolve_policy
from space_envs.dynamics.rotations import exponential
from space_envs.evaluation.harness.chunk_result import evaluate_chunk
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.entry import DIGITS, LeaderboardEntry
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.episode import SCHEMA_VERSION, EpisodeRecord
from space_envs.evaluation.records.timing import Timing
from space_envs.evaluation.replay.stills import Still
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.registration import ENTRIES
from space_envs.robots.robot import Robot
from space_envs.tasks.base import CaptureTask

FAILED: dict[str, Any] = {"captured": False, "outcome": "timeout", "time_to_capture": None}
HOSTILE = "<img src=x onerror=alert(1)>"


@dataclass(frozen=True)
class Character:
    """How a made-up policy behaves."""

    success: float
    peak: float  # deg
    final: float  # deg
    cost: float  # m^2/s
    seconds: float
    planning_ms: float | None
    action_ms: float


CHARACTERS = {
    "random": Character(0.0, 9.0, 5.0, 2e-2, 20, None, 0.01),
    "hold": Character(0.0, 0.0, 0.0, 0.0, 20, None, 0.005),
    "minimum_jerk": Character(0.98, 4.9, 4.7, 4.1e-3, 12.3, 9.0, 0.03),
    "gjm": Character(0.97, 5.3, 5.0, 8.5e-3, 9.1, None, 0.12),
    "mpc": Character(1.0, 5.0, 4.8, 6.0e-3, 12.9, 22.0, 0.9),
    "promp": Character(1.0, 4.9, 4.6, 4.6e-3, 12.4, 14.0, 0.04),
    "bc": Character(0.88, 5.4, 5.1, 8.8e-3, 10.2, None, 0.2),
    "ppo": Character(0.94, 3.9, 3.5, 7.1e-3, 7.6, None, 0.2),
}


def timed(planning_ms: float | None, action_ms: float) -> Timing:
    """On a processor that is made up."""
    return Timing(planning_ms=planning_ms, action_ms=action_ms, processor="made up", threads=1)


def make_record(**changes: object) -> EpisodeRecord:
    """A captured episode with the fields changed as asked; a failed one failed as its outcome says."""
    values: dict[str, object] = {
        "schema": SCHEMA_VERSION,
        "env_id": "SpaceCapture/SingleArm-v0",
        "robot": "",
        "robot_digest": "",
        "policy": "mpc",
        "control_mode": "joint_velocity",
        "knowledge": "model",
        "difficulty": "medium",
        "split": "test",
        "index": 0,
        "episode": 0,
        "seed": 0,
        "config_hash": "0123456789ab",
        "task_version": CaptureTask.version,
        "captured": True,
        "outcome": "captured",
        "cause": changes["outcome"] if changes.get("outcome", "captured") != "captured" else None,
        "reason": None,
        "time_to_capture": 12.5,
        "time_to_envelope": 11.5,
        "steps": 125,
        "episode_return": -0.25,
        "position_error": 0.003,
        "orientation_error": 0.5,
        "peak_attitude": 5.0,
        "final_attitude": 4.5,
        "attitude_cost": 0.006,
        "base_angular_impulse": 1.5,
        "kinetic_energy_integral": 2.5,
        "mechanical_work": 3.5,
        "peak_power": 4.5,
        "collisions": 0,
        "clipped_actions": 0,
        "linear_momentum_drift": 1e-7,
        "angular_momentum_drift": 2e-7,
        "timing": timed(20.0, 0.5),
    }
    values |= changes
    if not values["robot"]:
        env_id = str(values["env_id"])
        robot = _own_robot(env_id if env_id in ENTRIES else "SpaceCapture/SingleArm-v0")
        values |= {"robot": robot.title, "robot_digest": robot.digest[:DIGITS]}
    if "time_to_capture" in changes and "time_to_envelope" not in changes:
        time = changes["time_to_capture"]
        values["time_to_envelope"] = max(0.0, time - 1.0) if isinstance(time, float) else time
    return record_of(values)


@cache
def _own_robot(env_id: str) -> Robot:
    return evaluated(env_id)[1]


def changed(record: EpisodeRecord, **changes: object) -> EpisodeRecord:
    """The record with these keys of its JSON changed."""
    values = {name: value for name, value in record.to_dict().items() if name != "checksum"}
    return record_of(values | changes)


def failed(**changes: object) -> EpisodeRecord:
    """An episode that ended with its horizon."""
    return make_record(**(FAILED | changes))


def played(
    policy: str, attitudes: Sequence[float | None], seed: int = 0, start: int = 0, **changes: object
) -> list[EpisodeRecord]:
    """An episode for each attitude, at the end and at most; None is a failure that turned by 8 deg."""
    records = []
    for number, attitude in enumerate(attitudes):
        turned = 8.0 if attitude is None else attitude
        end = {"final_attitude": turned, "peak_attitude": turned} | (
            FAILED | {"steps": 200} if attitude is None else {}
        )
        place = {"policy": policy, "seed": seed, "episode": number, "index": start + number}
        records.append(make_record(**(place | end | changes)))
    return records


def rows_of(records: Sequence[EpisodeRecord], resamples: int = 200) -> list[Row]:
    return build_rows(records, np.random.default_rng(0), resamples=resamples)


def untimed(records: Iterable[EpisodeRecord]) -> list[dict[str, object]]:
    """What two runs of one seed must have in common."""
    return [{name: value for name, value in each.to_dict().items() if name != "timing"} for each in records]


def record_of(values: Mapping[str, object]) -> EpisodeRecord:
    """The record with these keys of its JSON, and no others."""
    names = [field.name for field in fields(EpisodeRecord)]
    metrics = {name: value for name, value in values.items() if name not in names}
    own = {name: value for name, value in values.items() if name in names}
    return EpisodeRecord(metrics=metrics, **own)  # type: ignore[arg-type]


def entry(policy: str) -> LeaderboardEntry:
    """Of the made-up evaluation."""
    return make_record(policy=policy).entry


def make_records(
    policy: str, character: Character, episodes: int, seeds: int, generator: np.random.Generator
) -> list[EpisodeRecord]:
    """Episodes of one policy, spread over seeds."""
    records = []
    for number in range(episodes):
        captured = bool(generator.random() < character.success)
        noise = generator.lognormal(0.0, 0.35)
        seconds = round(float(character.seconds * generator.uniform(0.8, 1.2)), 1)
        outcome = "captured" if captured else "timeout" if number % 3 else "attitude_lost"
        planning = character.planning_ms
        records.append(
            make_record(
                policy=policy,
                index=number,
                episode=number // seeds,
                seed=number % seeds,
                captured=captured,
                outcome=outcome,
                reason="base turned by more than 45 deg" if outcome == "attitude_lost" else None,
                time_to_capture=seconds if captured else None,
                steps=round(10 * seconds) if captured else 200,
                position_error=float((0.004 if captured else 0.6) * noise),
                orientation_error=float((0.4 if captured else 30) * noise),
                peak_attitude=character.peak * noise,
                final_attitude=character.final * noise,
                attitude_cost=character.cost * noise,
                timing=timed(
                    None if planning is None else planning * generator.lognormal(0, 0.1),
                    character.action_ms * generator.lognormal(0, 0.1),
                ),
            )
        )
    return records


def make_episodes(
    policy: str, character: Character, generator: np.random.Generator, count: int = 10
) -> EpisodeBatch:
    """Smooth motions of T = 200 steps that end where the character says."""
    period = 0.1
    phase = np.clip(period * np.arange(201) / character.seconds, 0, 1)
    s = phase**3 * (10 - 15 * phase + 6 * phase**2)
    scale = generator.lognormal(0, 0.35, size=(count, 1))
    bump = 16 * phase**2 * (1 - phase) ** 2
    axis = generator.normal(size=(count, 1, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    side = np.cross(axis, [0.3, 0.5, 0.8])
    main = scale * (character.final * s)
    rotation = main[..., None] * axis + 0.3 * character.peak * (scale * bump)[..., None] * side
    pose = np.concatenate([0.01 * rotation[..., ::-1], exponential(np.deg2rad(rotation))], axis=-1)
    joints = s[None, :, None] * generator.normal(size=(count, 1, 7))
    return EpisodeBatch(
        entry=entry(policy),
        robot=_own_robot("SpaceCapture/SingleArm-v0"),
        period=period,
        scene=np.concatenate([pose, joints], axis=-1),
        base_pose=pose,
        attitude=np.linalg.norm(rotation, axis=-1),
        position_error=0.004 + 0.8 * scale * (1 - s),
        orientation_error=0.4 + 40 * scale * (1 - s),
        length=np.full(count, 200),
        seed=np.zeros(count, dtype=np.int64),
        episode=np.arange(count),
        index=np.arange(count),
        outcome=np.full(count, "timeout"),
        goal={"mass_scale": np.ones(count)},
    )


def make_result(
    episodes: int = 50,
    seeds: int = 5,
    pictures: bool = False,
    extra: dict[str, Character] | None = None,
    policies: tuple[str, ...] = tuple(CHARACTERS),
) -> EvaluationResult:
    """The policies asked for and extra ones, always the same numbers."""
    generator = np.random.default_rng(7)
    records, recorded = [], {}
    chosen = {policy: CHARACTERS[policy] for policy in policies} | (extra or {})
    for policy, character in chosen.items():
        records += make_records(policy, character, episodes, seeds, generator)
        recorded[entry(policy)] = make_episodes(policy, character, generator)
    return EvaluationResult(
        records=records,
        episodes=recorded,
        provenance={
            "command": "evaluate.py --env SpaceCapture/SingleArm-v0 --policy random hold minimum_jerk gjm "
            "mpc promp bc ppo --split test --episodes 50 --seed 0",
            "seeds": list(range(seeds)),
            "commit": "3f2c9d1",
            "versions": {"python": "3.11.9", "mujoco": "4.0.0", "numpy": "2.4.6", "gymnasium": "1.4.0"},
            "machine": {"processor": "an x86-64 with 2 cores", "threads": 2, "system": "Linux"},
        },
        pictures={entry("mpc"): make_stills()} if pictures else {},
    )


@dataclass(frozen=True)
class PlayedEpisodes:
    """Real episodes of a built-in policy, rows and records in one order."""

    task: CaptureTask
    episodes: EpisodeBatch
    records: list[EpisodeRecord]


def make_played(policy: str, episodes: int, env_id: str = "SpaceCapture/SingleArm-v0") -> PlayedEpisodes:
    """Episodes of the test split, played now."""
    task, robot = evaluated(env_id)
    indices = tuple(range(episodes))
    made = evaluate_chunk(Chunk(resolve_policy(policy), task, robot, seed=0, first=0, indices=indices))
    records = [replace(record, timing=timed(1.0, 0.1)) for record in made.records]
    return PlayedEpisodes(made.episodes.task(), made.episodes, records)


def make_stills() -> list[Still]:
    """Six of them, 2.5 s apart."""
    return [Still(2.5 * number, make_picture(number / 5)) for number in range(6)]


def make_picture(phase: float) -> np.ndarray:
    """A black sky with a grey bar that turns: (240, 240, 3) uint8."""
    y, x = np.mgrid[-1:1:240j, -1:1:240j]
    angle = 1.5 * phase
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    bar = (np.abs(along) < 0.6) & (np.abs(across) < 0.08)
    picture = np.full((240, 240, 3), 8, dtype=np.uint8)
    picture[bar] = (190, 195, 205)
    return picture
