"""Policies on the dual-arm ids: captures with the attitude kept, predictions, evaluation, metrics."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from dual_arm_goals import IDS, task_of
from offenders import assert_refused
from rollouts import rollout_of

from agents.commands.evaluate import main
from agents.policies.dual_arm.observed import Reader
from agents.policies.dual_arm.reactionless_rate import ReactionlessRate, track_rates
from agents.policies.registry import POLICIES, make_policy, missing, policies_for
from agents.policies.resolve import resolve_policy
from space_envs.dynamics.rotations import Array, z_axis
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import PolicyError
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.rollout import Rollout
from space_envs.evaluation.records.metrics import episode_metrics
from space_envs.evaluation.records.storage import read_records
from space_envs.policy import PolicyContext
from space_envs.tasks.dual_arm import DualArmTask

SINGLE = "SpaceCapture/SingleArm-v0"
every_id = pytest.mark.parametrize("env_id", IDS)


def played(env_id: str, name: str, goals: Any, mode: str | None = None, **keywords: Any) -> Rollout:
    """Episodes of a policy on validation goals."""
    return rollout_of(name, goals, env_id, "validation", mode, **keywords)[0]


# Policies ---------------------------------------------------------------------------------------------


@every_id
@pytest.mark.parametrize("mode", ReactionlessRate.needs.control_modes)
def test_resolved_rate_captures_and_keeps_the_attitude(env_id: str, mode: str) -> None:
    rollout = played(env_id, "reactionless_rate", np.arange(32), mode)
    assert np.mean([outcome == "captured" for outcome in rollout.outcome]) >= 0.9
    assert "collision" not in rollout.outcome
    final = rollout.attitude[:, -1]
    if mode == "reactionless":
        assert rollout.attitude.max() < 0.01
    # In joint_velocity the drives stop single joints at their limits, which is not reactionless.
    assert np.mean(final < 0.1) >= 0.9
    assert rollout.attitude.max() < 1.0


class Blind(ReactionlessRate):
    """The resolved rate without a look at what may not be touched."""

    def __init__(self, context: PolicyContext) -> None:
        super().__init__(replace(context, contacts=None))


@pytest.mark.parametrize(("env_id", "goals"), [(IDS[0], 48), (IDS[1], 32)])
def test_resolved_rate_keeps_clear_on_hard_goals(env_id: str, goals: int) -> None:
    environment = {"env_id": env_id, "control_mode": "reactionless", "difficulty": "hard"}
    blind, seeing = (
        roll_out(policy, environment, "validation", np.arange(goals), 0)
        for policy in (Blind, ReactionlessRate)
    )
    count = {
        name: [np.count_nonzero(each.outcome == name) for each in (blind, seeing)]
        for name in ("collision", "captured")
    }
    assert count["collision"][0] >= 5 and count["collision"][1] == 0
    assert count["captured"][1] >= count["captured"][0] + 3
    assert seeing.attitude.max() < 0.01


@every_id
def test_keeping_clear_turns_no_satellite_and_each_row_is_alone(env_id: str) -> None:
    env = CaptureVectorEnv(env_id, 32, "reactionless", difficulty="hard", autoreset_mode="disabled")
    context = PolicyContext.from_env(env)
    policy, blind = ReactionlessRate(context), Blind(context)
    observation, _ = env.reset(seed=0, options={"split": "validation", "index": np.arange(32)})
    for _ in range(80):
        action, _ = policy.predict(observation)
        observation, *_ = env.step(action)
    change = track_rates(policy.reader, observation) - track_rates(blind.reader, observation)
    assert 3 <= (np.abs(change).max(axis=1) > 1e-3).sum() < 32
    q, rate = (policy.reader.field(observation, f"joint_{name}") for name in ("position", "velocity"))
    turning = context.arm.base_map(q + context.control_period * rate)[:, 3:]
    np.testing.assert_allclose(turning @ change[..., None], 0.0, atol=1e-10)
    together, _ = policy.predict(observation)
    alone = [policy.predict(observation[row : row + 1])[0][0] for row in range(32)]
    np.testing.assert_array_equal(alone, together)


@every_id
def test_resolved_rate_comes_to_rest_relative_to_the_grapple_points(env_id: str) -> None:
    env = CaptureVectorEnv(env_id, 8, "reactionless", autoreset_mode="disabled", hold_time=1e3)
    policy = ReactionlessRate(PolicyContext.from_env(env))
    observation, _ = env.reset(seed=0, options={"split": "validation", "index": np.arange(8)})
    distance, speed = [], []
    for _ in range(env.task.horizon):
        action, _ = policy.predict(observation)
        assert np.abs(action).max() <= 1.0
        observation, *_ = env.step(action)
        errors = env.task.errors(observation)
        distance.append(errors.position)
        speed.append(errors.linear_velocity)
    late = np.stack(distance)[-20:]
    # The damping, the posture and the pull towards the middle of the joints leave some millimetres, and
    # where a link would come too near to the target, the hand stops short, within the envelope of a capture.
    assert np.median(late) < 0.01 and np.sort(late.max(axis=0))[-2] < 0.03
    assert late.max() < policy.context.envelope.position
    assert np.median(np.stack(speed)[-20:]) < 2e-3


@every_id
def test_predicted_grapples_are_where_the_simulation_has_them_later(env_id: str) -> None:
    env = CaptureVectorEnv(env_id, 4, difficulty="hard", autoreset_mode="disabled", hold_time=1e3)
    reader = Reader(PolicyContext.from_env(env))
    observation, _ = env.reset(seed=0)
    for _ in range(30):
        observation, *_ = env.step(np.zeros(env.action_space.shape))
    times = np.array([0.0, 0.1, 5.0, 15.0])
    predicted = reader.goals(observation).at(times)
    for step in range(151):
        if step in (0, 1, 50, 150):
            place = (0, 1, 50, 150).index(step)
            for name in ("position", "linear_velocity"):
                seen = reader.vectors(observation, f"goal_{name}")
                np.testing.assert_allclose(getattr(predicted, name)[:, :, place], seen, atol=1e-7)
            if reader.aligned:
                seen = reader.vectors(observation, "goal_axis")
                np.testing.assert_allclose(z_axis(predicted.quaternion)[:, :, place], seen, atol=1e-7)
        observation, *_ = env.step(np.zeros(env.action_space.shape))
    assert reader.aligned == ("Spatial" in env_id)
    assert np.linalg.norm(predicted.position[:, :, 3] - predicted.position[:, :, 0], axis=-1).max() > 0.02


@every_id
def test_a_shifted_satellite_is_no_obstacle_to_a_policy(env_id: str) -> None:
    """What a policy does follows from the observation alone, in the satellite's frame."""
    env = CaptureVectorEnv(env_id, 4)
    observation, _ = env.reset(seed=0)
    context = PolicyContext.from_env(env)
    policy, layout = ReactionlessRate(context), context.layout
    moved = observation.copy()
    shift = np.array([0.7, -0.4, 0.2])[: layout.read(observation, "base_position").shape[1]]
    for name in ("base_position", "target_position", "end_effector_position", "goal_position"):
        part = layout.read(moved, name)
        part += np.tile(shift, part.shape[1] // len(shift))
    np.testing.assert_allclose(policy.predict(moved)[0], policy.predict(observation)[0], atol=1e-12)
    for row in range(4):
        alone = policy.predict(observation[row : row + 1])[0]
        np.testing.assert_allclose(alone[0], policy.predict(observation)[0][row], atol=1e-12)


# The table of policies --------------------------------------------------------------------------------


# Policies that act on each id. It is written down here alone: the program finds it from what they need.
ANYWHERE = ["random", "hold"]
POSES = ["minimum_jerk", "gjm", "mpc", "promp", "promp_mean", "ocp", "promp_optimal", "promp_optimal_kept"]
REACTIONLESS = ["reactionless", "reactionless_local", "reactionless_free", "reactionless_rate"]
CLONES = ["bc", "bc_reactionless"]
OFFERED = {
    SINGLE: [
        *(*ANYWHERE, *POSES, "promp_feedback", "promp_demonstrated"),
        *("promp_reactionless", "nmpc", "nmpc_reactionless", "bc", "ppo", "planner_network"),
        *("planner_network_alone", "reactionless_network", "reactionless_network_alone"),
    ],
    "SpaceCapture/SingleArmCluttered-v0": [*ANYWHERE, *POSES, "promp_avoiding", "promp_reactionless"],
    IDS[0]: [*ANYWHERE, *REACTIONLESS, "reactionless_ocp", *CLONES],
    IDS[1]: [*ANYWHERE, *REACTIONLESS, "reactionless_ocp", *CLONES],
}


def test_policies_are_offered_where_there_is_what_they_need() -> None:
    for env_id, names in OFFERED.items():
        assert policies_for(env_id) == [name for name in POLICIES if name in names], env_id
    assert missing("gjm", IDS[0])[0] == "it needs 1 arm, the task has 2 arms"
    assert missing("nmpc", "SpaceCapture/SingleArmCluttered-v0") == [
        "it needs no obstacles, the task has obstacles"
    ]
    assert missing("ppo", IDS[0]) == ["it needs weights 'ppo', those that ship are bc, bc_reactionless"]
    assert "static goals" in " ".join(missing("promp", IDS[1]))
    assert policies_for(IDS[1], "reactionless") == policies_for(IDS[1])
    assert policies_for(SINGLE, "joint_torque") == ANYWHERE


@pytest.mark.parametrize("name", ["reactionless_rate", "reactionless", "reactionless_local"])
def test_policies_refuse_other_tasks_and_modes(name: str) -> None:
    single = PolicyContext.from_env(CaptureVectorEnv(SINGLE))
    with pytest.raises(
        PolicyError, match="does not fit .*SingleArm-v0: it needs 2 arms, the task has 1 arm; .*moving goals"
    ):
        make_policy(name, single, 0)
    torque = PolicyContext.from_env(CaptureVectorEnv(IDS[0], control_mode="joint_torque"))
    with pytest.raises(PolicyError, match="'joint_velocity' or 'reactionless', the environment is in"):
        make_policy(name, torque, 0)
    env = CaptureVectorEnv(IDS[0])
    policy = make_policy(name, PolicyContext.from_env(env), 0)
    observation, _ = env.reset(seed=0)
    with pytest.raises(PolicyError, match="shape"):
        policy.predict(observation[0])
    with pytest.raises(PolicyError, match="finite"):
        policy.predict(np.full_like(observation, np.nan))


# evaluate.py ------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("brief_reports")
def test_evaluation_of_the_dual_arm_ids(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--env", *IDS, "--policy", "hold", "reactionless_rate", "--episodes", "3", "--no-pictures"]
    assert main([*arguments, "--jobs", "1", "--output", str(tmp_path)]) == 0
    assert "reactionless_rate" in capsys.readouterr().out
    records = read_records(tmp_path / "records.jsonl")
    entries = [(env_id, policy) for env_id in IDS for policy in ("hold", "reactionless_rate")]
    assert sorted((record.env_id, record.policy) for record in records) == sorted(3 * entries)
    for record in records:
        assert record.control_mode == "joint_velocity"
        if record.policy == "hold":
            assert record.outcome == "timeout" and record.metrics["steps"] == 300
            assert record.metrics["kinetic_energy_integral"] == record.metrics["mechanical_work"] == 0.0
            assert record.metrics["peak_attitude"] == 0.0
        else:
            assert record.captured
            assert (record.metrics["kinetic_energy_integral"] or 0.0) > 0.1
            drifts = (record.metrics["linear_momentum_drift"], record.metrics["angular_momentum_drift"])
            assert all(drift is not None and drift < 1e-5 for drift in drifts)
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert [row["policy"] for row in rows] == ["reactionless_rate", "hold"] * 2


def test_what_does_not_fit_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Any
) -> None:
    cases = [
        (["--env", IDS[0], "--policy", "gjm"], "does not fit SpaceCapture/DualArmPlanar-v0: it needs 1 arm"),
        (["--policy", "reactionless_rate"], "does not fit SpaceCapture/SingleArm-v0: it needs 2 arms"),
        (
            ["--env", IDS[0], "--policy", "hold", "--variant", "paper"],
            "unknown model variant 'paper'; valid are 'nominal'",
        ),
        (
            ["--env", IDS[0], "--policy", "reactionless_rate", "--control-mode", "joint_torque"],
            "joint_torque",
        ),
    ]
    assert_refused(lambda words: main([*words, "--output", str(tmp_path / "out")]), cases, capsys)
    assert not (tmp_path / "out").exists()


# Metrics against MuJoCo -------------------------------------------------------------------------------


def by_mujoco(task: DualArmTask, rollout: Rollout, row: int, measure: Callable[..., Any]) -> list[Any]:
    """`measure(model, data, b + n)` at every state of an episode, up to its end."""
    model = task.model.__copy__()
    base = model.body("satellite").id
    scale = float(rollout.goals.mass_scale[row])
    model.body_mass[base] *= scale
    model.body_inertia[base] *= scale
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    planar, n = task.kind == "planar", task.mechanics.n_joints
    size = (3 if planar else 6) + n
    found = []
    for step in range(rollout.length[row] + 1):
        qpos, qvel = rollout.qpos[row, step], rollout.qvel[row, step]
        data.qpos[:] = rollout.scene[row, step]
        data.qvel[:] = 0.0
        data.qvel[:size] = qvel if not planar else [*qvel[:2], qvel[5], *qvel[6:]]
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        np.testing.assert_allclose(data.body("satellite").xpos, qpos[:3], atol=1e-12)
        found.append(measure(model, data, size))
    return found


def energy(model: Any, data: Any, size: int) -> float:
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return 0.5 * data.qvel[:size] @ mass[:size, :size] @ data.qvel[:size]


def momentum(model: Any, data: Any, size: int) -> Array:
    base = model.body("satellite").id
    linear = model.body_subtreemass[base] * data.subtree_linvel[base]
    return np.concatenate([linear, data.subtree_angmom[base] + np.cross(data.subtree_com[base], linear)])


def base_spin(model: Any, data: Any, size: int) -> Array:
    base = model.body("satellite").id
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, base, velocity, 0)
    turn = data.ximat[base].reshape(3, 3)
    return turn @ np.diag(model.body_inertia[base]) @ turn.T @ velocity[:3]


@every_id
@pytest.mark.parametrize("split", ["validation", "ood"])
def test_metrics_are_those_of_mujocos_energies_and_momenta(env_id: str, split: str) -> None:
    # One step of the simulation a control period, so that what is recorded is all there is.
    step = task_of(env_id).step_size
    keywords: dict[str, Any] = {"horizon": 40, "control_period": step}
    task = task_of(env_id, **keywords)
    policy = resolve_policy("random")
    environment = {"env_id": env_id, "control_mode": "joint_velocity", **keywords}
    rollout = roll_out(policy.factory(0), environment, split, np.arange(2), 0)
    metrics = episode_metrics(rollout, task)
    for row in range(2):
        energies = np.array(by_mujoco(task, rollout, row, energy))
        assert energies.max() > 1e-3
        doubled = 2.0 * energies
        integral = step * (0.5 * (doubled[1:] + doubled[:-1])).sum()
        assert metrics["kinetic_energy_integral"][row] == pytest.approx(integral, rel=1e-9)
        # The work of the held torques is what the energy gains.
        turned = np.diff(rollout.qpos[row, :, 7:], axis=0)
        work = (rollout.torque[row] * turned).sum(axis=-1)
        np.testing.assert_allclose(work, np.diff(energies), atol=1e-6)
        assert metrics["mechanical_work"][row] == pytest.approx(np.abs(rollout.torque[row] * turned).sum())
        total = np.array(by_mujoco(task, rollout, row, momentum))
        change = total - total[0]
        for name, part in (("linear", change[:, :3]), ("angular", change[:, 3:])):
            drift = np.linalg.norm(part, axis=-1).max()
            assert metrics[f"{name}_momentum_drift"][row] == pytest.approx(drift, abs=1e-10)
        spins = np.array(by_mujoco(task, rollout, row, base_spin))
        impulse = np.linalg.norm(np.diff(spins, axis=0), axis=-1).sum()
        assert metrics["base_angular_impulse"][row] == pytest.approx(impulse, rel=1e-9)
        assert impulse > 1e-2
        assert metrics["final_attitude"][row] == rollout.attitude[row, -1]
        assert metrics["peak_attitude"][row] == rollout.attitude[row].max() > 1e-3
