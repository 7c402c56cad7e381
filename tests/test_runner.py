"""The harness: records do not depend on jobs, backends, kills or other policies' failures."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import harness_policies
import numpy as np
import pytest
from evaluated_tasks import evaluated
from synthetic_results import untimed

from agents.commands.evaluate import main
from agents.policies.resolve import resolve_policy
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.harness.chunk_result import ChunkResult, evaluate_chunk
from space_envs.evaluation.harness.evaluation import Evaluation
from space_envs.evaluation.harness.policy_times import ROUNDS, policy_times
from space_envs.evaluation.harness.runner import collect, play_missing, prepare
from space_envs.evaluation.play.chunks import CHUNK
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.process.limits import TimeLimits
from space_envs.evaluation.play.timing import PolicyTime
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.records.timing import UNTIMED
from space_envs.registration import make_task

ROOT = Path(__file__).resolve().parents[1]
ROBOTS = dict(
    evaluated(f"SpaceCapture/{name}-v0", split="validation") for name in ("SingleArm", "DualArmPlanar")
)
SINGLE, PLANAR = ROBOTS
HARNESS = "harness_policies"


def evaluation(
    *names: str,
    task: EvaluatedTask = SINGLE,
    episodes: int = 4,
    seeds: tuple[int, ...] = (0,),
    limits: TimeLimits | None = None,
) -> Evaluation:
    players = tuple((task, resolve_policy(name)) for name in names)
    return Evaluation(players, episodes, seeds, ROBOTS, limits)


def records_of(
    evaluated: Evaluation, folder: Path, jobs: int = 1, name: str = "loky", timed: bool = False
) -> list[EpisodeRecord]:
    prepare(evaluated, folder, resume=False)
    chunks = evaluated.chunks()
    play_missing(chunks, folder, jobs, name)
    return finished(evaluated, folder, timed)


def finished(evaluated: Evaluation, folder: Path, timed: bool = False) -> list[EpisodeRecord]:
    chunks = evaluated.chunks()
    times = policy_times(chunks, folder)[0] if timed else {chunk.entry: UNTIMED for chunk in chunks}
    return [record for played in collect(chunks, times, folder) for record in played.records]


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> tuple[Evaluation, list[EpisodeRecord]]:
    """Two policies, one of them stochastic, two seeds: in this process, one after the other."""
    evaluated = evaluation("gjm", "random", episodes=CHUNK + 2, seeds=(0, 3))
    return evaluated, records_of(evaluated, tmp_path_factory.mktemp("usual"))


def test_records_stand_by_policy_seed_and_episode(usual) -> None:
    evaluated, records = usual
    told = [(record.policy, record.seed, record.episode) for record in records]
    n = evaluated.episodes
    assert told == [(p, s, k) for p in ("gjm", "random") for s in (0, 3) for k in range(n)]
    assert len({record.index for record in records[:n]}) == n
    for policy in (0, 2 * n):  # a seed plays the same goals with every policy
        assert [r.index for r in records[policy : policy + n]] == [r.index for r in records[:n]]


@pytest.mark.parametrize(
    ("name", "package"),
    [("loky", "joblib"), pytest.param("ray", "ray", marks=pytest.mark.slow), ("dask", "distributed")],
)
def test_jobs_and_backends_leave_the_records_unchanged(
    name: str, package: str, usual, tmp_path: Path
) -> None:
    """On a real local cluster of two workers each; Ray in the default suite by test_extending."""
    pytest.importorskip(package)
    evaluated, records = usual
    made = records_of(evaluated, tmp_path, jobs=2, name=name)
    assert untimed(made) == untimed(records)


def test_a_cluster_that_runs_already_is_used_and_goes_on(usual, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    evaluated, records = usual
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        prepare(evaluated, tmp_path, resume=False)
        play_missing(evaluated.chunks(), tmp_path, 2, "dask", address)
        with distributed.Client(address) as client:
            assert client.submit(sum, (1, 2)).result() == 3
    assert untimed(finished(evaluated, tmp_path)) == untimed(records)


def command(folder: Path, *more: str) -> list[str]:
    policies = ["--policy", "gjm", "minimum_jerk", "mpc", "promp", "--split", "validation"]
    usual = ["--episodes", "75", "--jobs", "2", "--no-pictures", "--output", str(folder), *more]
    return [sys.executable, "evaluate.py", *policies, *usual]


@pytest.mark.slow
def test_killed_again_and_again_it_ends_with_the_same_records(tmp_path: Path) -> None:
    done = subprocess.run(command(tmp_path / "quiet"), cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    folder, kills = tmp_path / "killed", 0
    for number in range(20):
        more = ["--resume"] if number else []
        process = subprocess.Popen(
            command(folder, *more), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, process_group=0
        )
        try:
            process.communicate(timeout=4.0 + 0.7 * number)
            break
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            kills += 1
        for path in folder.glob("chunks/*.npz"):
            np.load(path, allow_pickle=False).close()  # whole, or not there
    assert process.returncode == 0
    assert kills >= 1
    made, undisturbed = (read_records(tmp_path / name / "records.jsonl") for name in ("killed", "quiet"))
    assert untimed(made) == untimed(undisturbed)
    assert not (folder / "chunks").exists()


@pytest.mark.usefixtures("brief_reports")
def test_killed_while_it_plays_it_ends_with_the_same_records(usual, tmp_path: Path) -> None:
    evaluated, records = usual
    arguments = ["--policy", "gjm", "random", "--split", "validation", "--seeds", "0,3", "--jobs", "2"]
    arguments += ["--episodes", str(evaluated.episodes), "--no-pictures", "--output", str(tmp_path)]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(
        [sys.executable, "evaluate.py", *arguments], cwd=ROOT, process_group=0, **quiet
    )
    while process.poll() is None and not list(tmp_path.glob("chunks/*.npz")):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert 0 < len(list(tmp_path.glob("chunks/*.npz"))) < len(evaluated.chunks())
    assert main([*arguments, "--resume"]) == 0
    assert untimed(read_records(tmp_path / "records.jsonl")) == untimed(records)


def test_killed_between_two_chunks_it_goes_on_where_it_was(usual, tmp_path: Path) -> None:
    evaluated, records = usual
    prepare(evaluated, tmp_path, resume=False)
    chunks = evaluated.chunks()
    play_missing(chunks[::2], tmp_path, 1)
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.glob("chunks/*.npz")}
    damaged = next(iter(kept))
    damaged.write_bytes(damaged.read_bytes()[:1000])  # as no kill can leave it, but a disk may
    del kept[damaged]
    prepare(evaluated, tmp_path, resume=True)
    play_missing(chunks, tmp_path, 1)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert untimed(finished(evaluated, tmp_path)) == untimed(records)


def test_a_resumed_evaluation_is_the_same_one(tmp_path: Path) -> None:
    prepare(evaluation("gjm"), tmp_path, resume=False)
    with pytest.raises(ConfigurationError, match=r"holds another evaluation: .*episodes was 4, is 5"):
        prepare(evaluation("gjm", episodes=5), tmp_path, resume=True)
    with pytest.raises(ConfigurationError, match="entries was"):
        prepare(evaluation("gjm", "hold"), tmp_path, resume=True)


def test_results_of_chunks_are_read_back_and_never_unpickled(tmp_path: Path) -> None:
    chunk = evaluation("hold").chunks()[0]
    result = evaluate_chunk(chunk)
    result.save(tmp_path / "chunk.npz")
    again = ChunkResult.load(tmp_path / "chunk.npz", chunk)
    assert again.records == result.records
    np.testing.assert_array_equal(again.episodes.scene, result.episodes.scene)
    np.savez(tmp_path / "bad.npz", records=np.array([Path()], dtype=object))
    with pytest.raises(ConfigurationError, match=r"bad\.npz is damaged"):
        ChunkResult.load(tmp_path / "bad.npz", chunk)
    with pytest.raises(ConfigurationError, match="other episodes"):
        ChunkResult.load(tmp_path / "chunk.npz", replace(chunk, indices=chunk.indices[::-1]))


@pytest.fixture(scope="module")
def well(tmp_path_factory: pytest.TempPathFactory) -> list[EpisodeRecord]:
    """Records of a policy that behaves."""
    return records_of(evaluation(f"{HARNESS}:Well", episodes=6), tmp_path_factory.mktemp("well"))


@pytest.mark.parametrize(
    ("name", "limits", "reason"),
    [
        ("Raises", None, "it raised ValueError: a goal that I do not like (step 3)"),
        ("NaNs", None, "the action held NaN or infinity at step 3"),
        ("Shapes", None, "it returned actions of shape (1, 14), expected (1, 7) (step 3)"),
        ("Leaves", None, "it raised SystemExit: 4 (step 3)"),
        ("Raises", TimeLimits(20.0, 20.0), "it raised ValueError: a goal that I do not like (step 3)"),
        ("Sleeps", TimeLimits(20.0, 1.0), "no action within 1 s (step 3)"),
        ("Ponders", TimeLimits(1.0, 20.0), "no first action within 1 s (step 0)"),
        ("Dies", TimeLimits(20.0, 20.0), "its process ended, with exit status 3 (step 3)"),
    ],
)
def test_a_policy_loses_only_the_episodes_that_it_spoils(
    name: str, limits: TimeLimits | None, reason: str, well: list[EpisodeRecord], tmp_path: Path
) -> None:
    ill = records_of(evaluation(f"{HARNESS}:{name}", episodes=6, limits=limits), tmp_path)
    goals = make_task(SINGLE.env_id, {}).goals(SINGLE.split, np.array([record.index for record in well]))
    spoilt = harness_policies.chosen(goals.position)
    assert 0 < spoilt.sum() < 6
    for record, undisturbed, bad in zip(ill, well, spoilt, strict=True):
        if bad:
            assert (record.outcome, record.captured) == ("policy_error", False)
            assert record.reason == reason
            at = getattr(harness_policies, name).at
            assert record.metrics["steps"] in (at, at + 1)
        else:
            assert record.outcome == undisturbed.outcome
            cost = undisturbed.metrics["attitude_cost"]
            assert record.metrics["attitude_cost"] == pytest.approx(cost, rel=1e-9)


def test_a_policy_that_closes_all_files_ends_without_a_traceback(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    made = records_of(evaluation(f"{HARNESS}:ClosesEverything", episodes=6), tmp_path)
    reasons = [str(record.reason) for record in made if record.outcome == "policy_error"]
    assert reasons
    # Its own status, or that of the harness, which ends it.
    assert set(reasons) <= {f"its process ended, with exit status {status} (step 3)" for status in (1, -9)}
    assert "Traceback" not in capfd.readouterr().err


def test_a_policy_that_cannot_be_built_is_told_before_anything_is_played(tmp_path: Path, capsys) -> None:
    assert main(["--policy", f"{HARNESS}:Unbuilt", "--output", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert f"policy '{HARNESS}:Unbuilt' could not be built with (context, seed): TypeError: " in told
    assert not (tmp_path / "out").exists()


def test_limits_that_are_kept_change_nothing(tmp_path: Path) -> None:
    free = records_of(evaluation(f"{HARNESS}:Prints", episodes=2), tmp_path / "free")
    limited = evaluation(f"{HARNESS}:Prints", episodes=2, limits=TimeLimits(60.0, 60.0))
    held = records_of(limited, tmp_path / "held", timed=True)
    for one, other in zip(held, free, strict=True):
        assert one.outcome == other.outcome
        assert one.metrics["attitude_cost"] == pytest.approx(other.metrics["attitude_cost"], rel=1e-9)
    assert held[0].timing["action_ms"] is not None


@pytest.mark.parametrize(
    ("name", "package"),
    [
        ("loky", "joblib"),
        pytest.param("ray", "ray", marks=pytest.mark.slow),
        pytest.param("dask", "distributed", marks=pytest.mark.slow),
    ],
)
def test_a_policy_that_ends_its_process_loses_only_its_own_episodes(
    name: str, package: str, tmp_path: Path
) -> None:
    """Whatever played beside it in the same processes; the others' bytes are those of an undisturbed run."""
    pytest.importorskip(package)
    quiet = records_of(evaluation("random", f"{HARNESS}:Well", episodes=8), tmp_path / "quiet")
    made = records_of(evaluation("random", f"{HARNESS}:Dies", episodes=8), tmp_path / "dead", 2, name)
    assert untimed(made[:8]) == untimed(quiet[:8])
    goals = make_task(SINGLE.env_id, {}).goals(SINGLE.split, np.array([record.index for record in made[8:]]))
    spoilt = harness_policies.chosen(goals.position)
    assert 0 < spoilt.sum() < 8
    for record, bad in zip(made[8:], spoilt, strict=True):
        assert (record.outcome == "policy_error") == bad
        assert record.reason == ("its process ended, with exit status 3 (step 3)" if bad else None)


@pytest.mark.parametrize("name", ["Raises", "NaNs", "Shapes", "Leaves", "Well"])
def test_a_process_of_its_own_changes_nothing(name: str) -> None:
    (chunk,) = evaluation(f"{HARNESS}:{name}", episodes=6).chunks()
    goals = make_task(SINGLE.env_id, {}).goals(SINGLE.split, np.array(chunk.indices))
    spoilt = harness_policies.chosen(goals.position)
    indices = np.array(chunk.indices)[[spoilt.argmin(), spoilt.argmax()]]  # one of each kind
    here, apart = (
        roll_out(chunk.build, chunk.environment, SINGLE.split, indices, chunk.seed, apart=away)
        for away in (False, True)
    )
    assert apart.outcome.tolist() == here.outcome.tolist()
    assert apart.reason.tolist() == here.reason.tolist()
    np.testing.assert_array_equal(apart.torque, here.torque)
    np.testing.assert_array_equal(apart.qpos, here.qpos)


def test_a_policy_draws_anew_in_each_unit_and_seed() -> None:
    evaluated = evaluation("random", "hold", episodes=2 * CHUNK, seeds=(0, 1))
    drawn = {chunk: chunk.policy_seed for chunk in evaluated.chunks()}
    assert len(drawn) == 8
    for name in ("random", "hold"):
        own = [seed for chunk, seed in drawn.items() if chunk.policy.name == name]
        assert len(set(own)) == 4


def test_timing_is_of_one_thread_and_names_the_processor(tmp_path: Path) -> None:
    for record in records_of(evaluation("gjm", "random", episodes=2), tmp_path, timed=True):
        assert record.timing["threads"] == 1
        assert record.timing["processor"]
        assert record.timing["action_ms"] is not None


@pytest.mark.parametrize(
    ("told", "planning", "action"),
    [
        ([(9.0, 0.3), (7.0, 0.5)], 7.0, 0.3),
        ([(None, 0.3), (None, 0.2)], None, 0.2),
        ([(9.0, 0.3), (None, 0.5)], None, 0.3),
        ([None], None, None),
        ([(9.0, 0.3), None], None, None),
    ],
)
def test_the_fastest_of_several_rounds_is_its_time(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    told: list[tuple[float | None, float] | None],
    planning: float | None,
    action: float | None,
) -> None:
    evaluated = evaluation("gjm", "hold")
    prepare(evaluated, tmp_path, resume=False)
    chunks = evaluated.chunks()
    rounds, turns = {"gjm": iter(told), "hold": iter([(None, 1.0)] * ROUNDS)}, []

    def timed(call: Any) -> PolicyTime:
        (chunk,) = call[1]
        turns.append(chunk.policy.name)
        one = next(rounds[chunk.policy.name])
        if one is None:
            raise PolicyError("it took too long")
        return PolicyTime(*one)

    monkeypatch.setattr("space_envs.evaluation.harness.policy_times.elsewhere", timed)
    found = {entry.policy: timing for entry, timing in policy_times(chunks, tmp_path)[0].items()}
    assert (found["gjm"]["planning_ms"], found["gjm"]["action_ms"]) == (planning, action)
    assert (found["hold"]["planning_ms"], found["hold"]["action_ms"]) == (None, 1.0)
    # One after the other rather than all of one policy, and no more of one that failed.
    assert turns == ["gjm", "hold"] * len(told) + ["hold"] * (ROUNDS - len(told))
    monkeypatch.setattr(
        "space_envs.evaluation.harness.policy_times.elsewhere", lambda *_: pytest.fail("it was timed before")
    )
    policy_times(chunks, tmp_path)


@pytest.mark.usefixtures("brief_reports")
def test_several_ids_splits_and_seeds_in_one_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ids = [SINGLE.env_id, PLANAR.env_id]
    more = ["--split", "validation", "train", "--episodes", "2", "--seeds", "0-1", "--no-pictures"]
    policies = ["--policy", "gjm", "hold"]
    assert main(["--env", *ids, *policies, *more, "--output", str(tmp_path), "--jobs", "1"]) == 0
    records = read_records(tmp_path / "records.jsonl")
    entries = {(record.env_id, record.split, record.policy) for record in records}
    # gjm is made for one arm alone.
    assert entries == {(ids[0], split, p) for split in ("validation", "train") for p in ("gjm", "hold")} | {
        (ids[1], split, "hold") for split in ("validation", "train")
    }
    assert len(records) == 6 * 2 * 2
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {record.config_hash for record in records} == set(summary["provenance"]["configurations"])
    capsys.readouterr()
