"""evaluate.py: records that repeat, metrics that obey physics, policies of a user's own, clear errors."""

import itertools
import json
import sys
from types import SimpleNamespace

import harness_policies
import numpy as np
import pytest

from agents.commands.evaluate import main
from agents.planning import Cause, Failure
from agents.registry import POLICIES, Entry
from agents.resolve import resolve_policy
from space_envs.evaluation import runner
from space_envs.evaluation.causes import PlanState
from space_envs.evaluation.leaderboard import cost_times_duration
from space_envs.evaluation.metrics import episode_metrics, episode_records
from space_envs.evaluation.records import NO_PLAN_CAUSES, Entrant, Task, read_records, records_without_timing
from space_envs.evaluation.rollout import roll_out, split_indices, time_policy
from space_envs.evaluation.runner import Evaluation, prepare
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


def rollout_of(name, episodes=6, apart=False, **keywords):
    task = make_task(SINGLE, keywords)
    policy = resolve_policy(name)
    environment = {"env_id": SINGLE, "control_mode": policy.control_mode, **keywords}
    return roll_out(policy.factory(0), environment, "test", np.arange(episodes), 0, apart=apart), task


def test_same_seed_same_bytes_apart_from_timing(tmp_path, capsys):
    for folder in ("a", "b"):
        assert main(["--policy", "random", "gjm", *QUICK, "--output", str(tmp_path / folder)]) == 0
    out = capsys.readouterr().out
    assert "gjm" in out
    assert str(tmp_path / "b" / "report.html") in out.replace("\n", "")
    a, b = (read_records(tmp_path / folder / "records.jsonl") for folder in ("a", "b"))
    assert records_without_timing(a) == records_without_timing(b)
    assert len(a) == 8
    for kind in ("traces", "states"):
        names = [sorted(path.name for path in (tmp_path / folder / kind).iterdir()) for folder in ("a", "b")]
        assert names[0] == names[1]
        assert len(names[0]) == 2
    summaries = [json.loads((tmp_path / folder / "summary.json").read_text()) for folder in ("a", "b")]
    for summary in summaries:
        assert summary["provenance"].pop("timing")
        assert summary["checksums"].pop("records.jsonl")  # its lines have timing too
        assert summary["provenance"].pop("command")
        assert len(summary["checksums"]) == 4  # traces and states
        for row in summary["rows"]:
            row.pop("timing")
    assert summaries[0] == summaries[1]


def test_goals_follow_the_seed_and_never_repeat():
    task = make_task(SINGLE, {})
    first, again, other = (split_indices(task, "test", 100, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first)) == 100
    assert not np.array_equal(first, other)


def test_attitude_cost_is_minus_the_attitude_reward():
    rollout, task = rollout_of("minimum_jerk", reward="sparse")
    metrics = episode_metrics(rollout, task)
    captured = np.array([outcome == "captured" for outcome in rollout.outcome])
    # Sparse rewards are the attitude term and one for a capture, nothing else.
    np.testing.assert_allclose(rollout.episode_return, captured - metrics["attitude_cost"], atol=1e-12)
    assert captured.all()


@pytest.mark.parametrize("name", ["minimum_jerk", "random"])
def test_torques_times_angles_make_the_kinetic_energy(name):
    """The work of torques held over each step is exactly what the robot's kinetic energy gains."""
    from space_envs.dynamics.bodies import body_motion

    rollout, task = rollout_of(name)
    motion = body_motion(task.robot, rollout.qpos, rollout.qvel)
    work = (rollout.torque * np.diff(rollout.qpos[..., 7:], axis=1)).sum(axis=-1)
    gained = np.diff(motion.kinetic_energy, axis=1)
    assert gained.max() > 0.01
    np.testing.assert_allclose(work, gained, atol=1e-6)
    metrics = episode_metrics(rollout, task)
    assert (metrics["mechanical_work"] >= np.abs(work.sum(axis=1)) - 1e-9).all()
    assert (metrics["peak_power"] * task.control_period >= np.abs(gained).max(axis=1) - 1e-6).all()
    assert (metrics["linear_momentum_drift"] < 1e-6 * np.abs(motion.linear).max()).all()
    assert (metrics["angular_momentum_drift"] < 1e-6 * np.abs(motion.angular).max()).all()


def test_slowness_makes_a_path_cheap_by_eq_20_and_not_by_cost_times_duration(monkeypatch):
    """The same minimum-jerk paths, planned for 5, 10 and 20 s."""
    costs, products = [], []
    for duration in (5.0, 10.0, 20.0):
        monkeypatch.setattr("agents.tracking.DURATION", duration)
        rollout, task = rollout_of("minimum_jerk", episodes=4)
        records = episode_records(rollout, task, Entrant(Task(SINGLE, "medium", "test"), "mine", "any"), 0)
        assert rollout.outcome == ["captured"] * 4
        costs.append([record.attitude_cost for record in records])
        products.append([cost_times_duration(record) for record in records])
    cost, product = np.array(costs), np.array(products)
    np.testing.assert_allclose(cost[1:] / cost[:-1], 0.5, rtol=0.03)
    # What is left is the start and the end of a motion, which the envelope cuts off differently.
    assert (product.max(axis=0) / product.min(axis=0)).max() < 1.15


def test_the_time_to_the_envelope_is_that_of_the_first_state_of_the_hold():
    rollout, task = rollout_of("minimum_jerk", episodes=2)
    records = episode_records(rollout, task, Entrant(Task(SINGLE, "medium", "test"), "mine", "any"), 0)
    for row, record in enumerate(records):
        inside = rollout.position_error[row] <= task.envelope.position
        assert record.time_to_envelope is not None and record.time_to_capture is not None
        assert record.time_to_envelope == pytest.approx(record.time_to_capture - task.envelope.hold)
        assert inside[round(record.time_to_envelope / task.control_period) :].all()


def test_metrics_do_not_count_what_comes_after_the_end():
    rollout, task = rollout_of("gjm")
    assert (rollout.length < task.horizon).all()
    after = np.arange(rollout.torque.shape[1]) >= rollout.length[:, None]
    assert (rollout.torque[after] == 0).all()
    last = rollout.qpos[np.arange(6), rollout.length]
    np.testing.assert_array_equal(rollout.qpos[:, -1], last)


def test_a_policy_that_returns_nan_loses_that_episode_only():
    rollout, _ = rollout_of(f"{__name__}:Nan")
    assert rollout.outcome == ["timeout", "policy_error"] * 3
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
    assert rollout.outcome == ["timeout"] * 6
    assert rollout.cause == ["timeout", "joint_limit", "no_plan"] * 2
    assert rollout.reason == [None, "joint 3 at 2.1 rad", "out of ideas"] * 2


def test_what_a_policy_says_malformed_is_counted_as_no_plan_or_as_nothing():
    rollout, _ = rollout_of(f"{__name__}:Malformed", horizon=5)
    assert rollout.cause == ["no_plan"] * 6
    assert rollout.reason[0] == "the stars"
    assert rollout.reason[1] == "the policy gave a int for a reason"
    rollout, _ = rollout_of(f"{__name__}:Miscounted", horizon=5)
    assert rollout.cause == ["timeout"] * 6


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
    assert rollout.cause == ["timeout"] * 2
    assert rollout.reason == [None] * 2


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
    assert rollout.outcome == ["policy_error"] * 2
    assert rollout.reason == [reason] * 2
    assert (rollout.length == 0).all()
    assert all(np.isfinite(value).all() for value in episode_metrics(rollout, task).values())


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
def test_an_exception_of_a_built_in_policy_is_no_score(policy, built_in, said, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(harness_policies.Well, "bad", lambda self, observation: np.ones(1, dtype=bool))
    if built_in:
        monkeypatch.setitem(POLICIES, policy, Entry(policy, "fails"))
    arguments = ["--policy", policy, *QUICK, "--jobs", "1", "--output", str(tmp_path / "out")]
    for more in ([], ["--resume"]):
        assert main([*arguments, *more]) == (0 if said is None else 1)
        told = capsys.readouterr().err
        assert ("that is a fault of this project" in told) == (said is not None)
        if said is not None:
            assert f"evaluate.py: built-in policy {policy!r} failed on {SINGLE}, {said}" in told
    records = read_records(tmp_path / "out" / "records.jsonl")
    assert {record.outcome for record in records} == {"policy_error"}


@pytest.mark.parametrize(("first", "planning"), [(2.5, 2250.0), (0.25, None), (2.4, None)])
def test_timing_tells_planning_from_acting(monkeypatch, first, planning):
    monkeypatch.setattr("space_envs.evaluation.rollout.perf_counter", lambda: Ticking.clock)
    monkeypatch.setattr(Ticking, "first", first)
    timing = time_policy(lambda context: Ticking(context, 0), {"env_id": SINGLE}, "test", np.arange(2))
    assert timing.action == pytest.approx(250.0)
    assert timing.planning == (None if planning is None else pytest.approx(planning))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
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
    ],
)
def test_bad_input_is_one_line_and_status_2_before_work_starts(arguments, message, capsys, tmp_path):
    output = tmp_path / "out"
    assert main([*arguments, "--output", str(output)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not output.exists()


def test_a_complete_evaluation_is_not_played_again_by_resume(tmp_path, capsys):
    folder = tmp_path / "out"
    arguments = ["--policy", "hold", *QUICK, "--output", str(folder)]
    assert main(arguments) == 0
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("[!.]*")}
    capsys.readouterr()
    assert main([*arguments, "--resume"]) == 0
    told = capsys.readouterr()
    assert "hold" in told.out and str(folder / "report.html") in told.out
    assert told.err == f"note: {folder} is complete; nothing was played\n"
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("[!.]*")} == before
    # Parts that somebody removed, of an evaluation that had no end, are played again.
    (folder / "summary.json").unlink()
    assert main([*arguments, "--resume"]) == 0
    assert "complete" not in capsys.readouterr().err
    assert (folder / "summary.json").exists()


def test_a_restart_that_was_killed_is_not_complete(tmp_path, monkeypatch):
    task = Task(SINGLE, "medium", "test")
    evaluation = Evaluation(((task, resolve_policy("hold")),), 4, (3,))
    (tmp_path / "summary.json").write_text("{}")  # of an evaluation before
    assert prepare(evaluation, tmp_path)
    (tmp_path / "parts").rmdir()  # it had come to its end
    assert not prepare(evaluation, tmp_path, resume=True)

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(runner, "remove_files", killed)
        with pytest.raises(KeyboardInterrupt):
            prepare(evaluation, tmp_path, overwrite=True)
    assert prepare(evaluation, tmp_path, resume=True)


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
