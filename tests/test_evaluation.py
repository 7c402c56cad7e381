"""evaluate.py: records that repeat, metrics that obey physics, policies of a user's own, clear errors."""

import itertools
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import harness_policies
import numpy as np
import pytest
from evaluated_tasks import evaluated
from offenders import assert_refused
from rollouts import rollout_of
from synthetic_results import untimed

from agents.commands.evaluate import main
from agents.planners.common.plans import Cause, Failure
from agents.policies.registry import POLICIES, RegisteredPolicy
from agents.policies.resolve import resolve_policy
from space_envs.errors import RenderingError
from space_envs.evaluation.harness import runner
from space_envs.evaluation.harness.evaluation import Evaluation
from space_envs.evaluation.harness.runner import prepare
from space_envs.evaluation.play.causes import NO_PLAN_CAUSES, PlanState
from space_envs.evaluation.play.playing import split_indices
from space_envs.evaluation.play.timing import time_policy
from space_envs.evaluation.records.metrics import episode_metrics
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.replay import videos
from space_envs.registration import make_task

SINGLE = "SpaceCapture/SingleArm-v0"
QUICK = ["--episodes", "4", "--seed", "3", "--no-pictures"]


class Nan:
    """Gives up in odd rows after five steps."""

    def __init__(self, context, seed):
        self.size = len(context.action_scale)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        step = 0 if state is None else state
        action = np.zeros((len(observation), self.size))
        if step == 5:
            action[1::2] = np.nan
        return action, step + 1


class Raises(Nan):
    """Raises at once."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        raise RuntimeError("out of ideas")


class Misshapen(Nan):
    """One action for all rows."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(self.size), None


@pytest.mark.usefixtures("brief_reports")
def test_same_seed_same_bytes_apart_from_timing(tmp_path, capsys):
    for folder in ("a", "b"):
        assert main(["--policy", "random", "gjm", *QUICK, "--output", str(tmp_path / folder)]) == 0
    out = capsys.readouterr().out
    assert "gjm" in out
    assert str(tmp_path / "b" / "report.html") in out.replace("\n", "")
    a, b = (read_records(tmp_path / folder / "records.jsonl") for folder in ("a", "b"))
    assert untimed(a) == untimed(b)
    assert len(a) == 8
    names = [sorted(path.name for path in (tmp_path / name / "episodes").iterdir()) for name in ("a", "b")]
    assert names[0] == names[1]
    assert len(names[0]) == 2
    summaries = [json.loads((tmp_path / folder / "summary.json").read_text()) for folder in ("a", "b")]
    for summary in summaries:
        assert summary["provenance"].pop("timing")
        assert summary["checksums"].pop("records.jsonl")  # its lines have timing too
        assert summary["provenance"].pop("command")
        assert len(summary["checksums"]) == 2  # episodes
        for row in summary["rows"]:
            row.pop("timing")
    assert summaries[0] == summaries[1]


def test_goals_follow_the_seed_and_never_repeat():
    task = make_task(SINGLE, {})
    first, again, other = (split_indices(task, "test", 100, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first)) == 100
    assert not np.array_equal(first, other)


def test_a_policy_that_returns_nan_loses_that_episode_only():
    rollout, _ = rollout_of(f"{__name__}:Nan")
    assert rollout.outcome.tolist() == ["timeout", "policy_error"] * 3
    assert rollout.reason[1] == "the action held NaN or infinity at step 5"
    assert rollout.reason[0] is None
    assert np.isfinite(rollout.qpos).all()


class Told(PlanState):
    """A state that says which episodes have no plan."""

    def __init__(self, failures):
        self.failures = failures


class Planless(Nan):
    """Has no plan for odd rows, and says so in its state."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        told = [None, Failure("mine", Cause.JOINT_LIMIT, "joint 3 at 2.1 rad"), "out of ideas"]
        failures = [told[row % 3] for row in range(len(observation))]
        return np.zeros((len(observation), self.size)), Told(failures)


class Malformed(Nan):
    """Says in its state what no record can hold."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        told = [SimpleNamespace(cause="out of luck", reason="the stars"), 3, ValueError()]
        failures = [told[row % 3] for row in range(len(observation))]
        return np.zeros((len(observation), self.size)), Told(failures)


class Miscounted(Nan):
    """Says in its state why there is no plan, for another number of episodes."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), self.size)), Told(["out of ideas"])


@pytest.mark.parametrize("apart", [False, True])
def test_why_there_was_no_plan_is_the_cause_of_a_failed_episode(apart):
    rollout, _ = rollout_of(f"{__name__}:Planless", horizon=5, apart=apart)
    assert rollout.outcome.tolist() == ["timeout"] * 6
    assert rollout.cause.tolist() == ["timeout", "joint_limit", "no_plan"] * 2
    assert rollout.reason.tolist() == [None, "joint 3 at 2.1 rad", "out of ideas"] * 2


def test_what_a_policy_says_malformed_is_counted_as_no_plan_or_as_nothing():
    rollout, _ = rollout_of(f"{__name__}:Malformed", horizon=5)
    assert rollout.cause.tolist() == ["no_plan"] * 6
    assert rollout.reason[0] == "the stars"
    assert rollout.reason[1] == "the policy gave a int for a reason"
    rollout, _ = rollout_of(f"{__name__}:Miscounted", horizon=5)
    assert rollout.cause.tolist() == ["timeout"] * 6


class Endless(Nan):
    """Says so for ever."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), self.size)), Told(itertools.repeat("out of ideas"))


class Namesake(Nan):
    """Has a state of its own with an attribute of that name, which is none of the harness's business."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        failures = ["out of ideas"] * len(observation)
        return np.zeros((len(observation), self.size)), SimpleNamespace(failures=failures)


class Trap:
    """A state that raises whatever is asked of it."""

    def __getattribute__(self, name):
        raise GeneratorExit

    __len__ = __iter__ = __copy__ = __deepcopy__ = __bool__ = __getattribute__


class Trapped(Nan):
    """Has such a state."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), self.size)), Trap()


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("name", ["Endless", "Namesake", "Trapped"])
def test_other_states_are_not_looked_at(name, apart):
    rollout, _ = rollout_of(f"{__name__}:{name}", episodes=2, horizon=3, apart=apart)
    assert rollout.cause.tolist() == ["timeout"] * 2
    assert rollout.reason.tolist() == [None] * 2


def test_every_cause_of_a_planner_is_one_of_the_records():
    assert {str(cause) for cause in Cause} == set(NO_PLAN_CAUSES) - {"no_plan"}


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Raises", "it raised RuntimeError: out of ideas (step 0)"),
        ("Misshapen", "it returned actions of shape (7,), expected (1, 7) (step 0)"),
    ],
)
def test_a_policy_that_raises_or_misshapes_loses_its_episodes(name, reason):
    rollout, task = rollout_of(f"{__name__}:{name}", episodes=2)
    assert rollout.outcome.tolist() == ["policy_error"] * 2
    assert rollout.reason.tolist() == [reason] * 2
    assert (rollout.length == 0).all()
    values = episode_metrics(rollout, task)
    assert {name for name, value in values.items() if np.isnan(value).all()} == set(TIMES)
    assert all(np.isfinite(value).all() for name, value in values.items() if name not in TIMES)


TIMES = ("time_to_capture", "time_to_envelope")  # of captures alone


class Ticking(Nan):
    """Takes as long as it says on a clock of its own: `first` s for the first call, 0.25 s for later ones."""

    clock, first = 0.0, 0.25

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        Ticking.clock += self.first if np.all(episode_start) else 0.25
        return np.zeros((len(observation), self.size)), None


@pytest.mark.parametrize(
    ("policy", "built_in", "said"),
    [
        (
            "harness_policies:Raises",
            True,
            "in 4 episodes: it raised ValueError: a goal that I do not like (step 0)",
        ),
        (f"{__name__}:Raises", False, None),
        ("harness_policies:HasNoPlan", True, None),
    ],
)
@pytest.mark.usefixtures("brief_reports")
def test_an_exception_of_a_built_in_policy_is_no_score(policy, built_in, said, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(harness_policies.Well, "bad", lambda self, observation: np.ones(1, dtype=bool))
    if built_in:
        monkeypatch.setitem(POLICIES, policy, RegisteredPolicy(policy, "fails"))
    arguments = ["--policy", policy, *QUICK, "--jobs", "1", "--output", str(tmp_path / "out")]
    for more in ([], ["--resume"]):
        assert main([*arguments, *more]) == (0 if said is None else 1)
        told = capsys.readouterr().err
        assert ("that is a fault of this project" in told) == (said is not None)
        if said is not None:
            assert f"evaluate.py: built-in policy {policy!r} failed on {SINGLE}, {said}" in told
    records = read_records(tmp_path / "out" / "records.jsonl")
    assert {record.outcome for record in records} == {"policy_error"}


@pytest.mark.parametrize(("first", "planning"), [(1.25, 1000.0), (0.25, None), (1.2, None)])
def test_timing_tells_planning_from_acting(monkeypatch, first, planning):
    monkeypatch.setattr("space_envs.evaluation.play.timing.perf_counter", lambda: Ticking.clock)
    monkeypatch.setattr(Ticking, "first", first)
    timing = time_policy(lambda context: Ticking(context, 0), {"env_id": SINGLE}, "test", np.arange(2))
    assert timing.action == pytest.approx(250.0)
    assert timing.planning == (None if planning is None else pytest.approx(planning))


def test_bad_input_is_one_line_and_status_2_before_work_starts(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    cases = [
        (["--policy", "gmj"], "Did you mean 'gjm'"),
        (["--policy", "gjm", "gjm"], "policy given twice: gjm"),
        (["--policy", "no_such_module:Policy"], "no_such_module"),
        (["--env", "SpaceCapture/SingelArm-v0"], "Did you mean 'SpaceCapture/SingleArm-v0'"),
        (["--split", "tets"], "Did you mean 'test'"),
        (["--difficulty", "hrad"], "Did you mean 'hard'"),
        (["--episodes", "513"], "1..512"),
        (["--episodes", "0"], "1..512"),
        (["--seeds", "4-2"], "seeds are numbers and ranges"),
        (["--jobs", "0"], "jobs must be at least 1"),
        (["--backend", "lokey"], "Did you mean 'loky'"),
        (["--time-limit", "-1"], "--time-limit must be a finite positive number, got -1.0"),
        (["--time-limit", "nan"], "--time-limit must be a finite positive number"),
        (["--time-limit", "1", "--planning-limit", "0"], "--planning-limit must be a finite positive number"),
        (["--policy", "runs/none"], "there is no run's folder 'runs/none'"),
        (["--policy", "model.zip"], "there is no zip of stable-baselines3 'model.zip'"),
        (["--policy", "agents/data/policies/SingleArm-v0/bd.npz"], "SingleArm-v0/bc.npz'?"),
        (["--policy", ""], "a policy needs a name"),
        (["sohw"], "unknown command 'sohw'; there are compare, show, replay, dataset"),
        (["cmpare", "a"], "Did you mean 'compare'?"),
        (["--planning-limit", "1"], "goes with --time-limit"),
        (["--control-mode", "torque"], "Did you mean 'joint_torque'"),
        (["--policy", "hold", "gjm", "--control-mode", "joint_torque"], "control mode 'joint_velocity'"),
    ]
    assert_refused(lambda words: main([*words, "--output", str(tmp_path / "out")]), cases, capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("brief_reports")
def test_a_complete_evaluation_is_not_played_again_by_resume(tmp_path, capsys):
    folder = tmp_path / "out"
    arguments = ["--policy", "hold", *QUICK, "--output", str(folder)]
    assert main(arguments) == 0
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("[!.]*")}
    capsys.readouterr()
    assert main([*arguments, "--resume"]) == 0
    told = capsys.readouterr()
    assert "hold" in told.out and str(folder / "report.html") in told.out
    assert told.err == f"note: {folder} is complete; nothing was evaluated\n"
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("[!.]*")} == before
    # Parts that somebody removed, of an evaluation that had no end, are played again.
    (folder / "summary.json").unlink()
    assert main([*arguments, "--resume"]) == 0
    assert "complete" not in capsys.readouterr().err
    assert (folder / "summary.json").exists()


def test_a_restart_that_was_killed_is_not_complete(tmp_path, monkeypatch):
    task, robot = evaluated(SINGLE)
    evaluation = Evaluation(((task, resolve_policy("hold")),), 4, (3,), {task: robot})
    (tmp_path / "summary.json").write_text("{}")  # of an evaluation before
    assert prepare(evaluation, tmp_path)
    (tmp_path / "chunks").rmdir()  # it had come to its end
    assert not prepare(evaluation, tmp_path, resume=True)

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(runner, "remove_files", killed)
        with pytest.raises(KeyboardInterrupt):
            prepare(evaluation, tmp_path, overwrite=True)
    assert prepare(evaluation, tmp_path, resume=True)


@pytest.mark.usefixtures("brief_reports")
def test_a_users_own_class_runs_by_its_name(tmp_path, capsys, monkeypatch):
    (tmp_path / "my_package.py").write_text(
        "import numpy as np\n"
        "class Still:\n"
        "    def __init__(self, context, seed):\n"
        "        self.size = len(context.action_scale)\n"
        "    def predict(self, observation, state=None, episode_start=None, deterministic=True):\n"
        "        return np.zeros((len(observation), self.size)), state\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["--policy", "my_package:Still", *QUICK, "--output", str(tmp_path / "out")]) == 0
    assert "my_package:Still" in capsys.readouterr().out
    sys.modules.pop("my_package")
    assert {record.outcome for record in read_records(tmp_path / "out" / "records.jsonl")} == {"timeout"}


@pytest.mark.usefixtures("brief_reports")
def test_videos_that_cannot_be_drawn_are_no_silence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def cannot(*_: object) -> None:
        raise RenderingError("this machine has no OpenGL")

    monkeypatch.setattr(videos, "write_video", cannot)
    words = ["--policy", "hold", "--episodes", "1", "--split", "validation", "--jobs", "1", "--no-pictures"]
    assert main([*words, "--videos", "--output", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err.count("There are no videos: this machine has no OpenGL") == 1
