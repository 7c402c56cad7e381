"""Control modes: momentum, tracking, limits, what each action means, and the recorded metrics' physics."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from space_envs.control import CONTROL_MODES, STOP_MARGIN
from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.models.parameters import SINGLE_ARM, VARIANTS
from space_envs.registration import ENTRIES

IDS = sorted(ENTRIES)


def recorded(env, actions):
    """qpos (N, T + 1, .), qvel, torques (N, T, n) along actions (T, N, m) from the present state."""
    simulation, states, torques = env.simulation, [], []
    for action in actions:
        states.append((simulation.qpos.copy(), simulation.qvel.copy()))
        env.step(action)
        torques.append(simulation.ctrl.copy())
    states.append((simulation.qpos.copy(), simulation.qvel.copy()))
    qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
    return qpos, qvel, np.stack(torques, axis=1)


def endless(env_id=IDS[0], n=16, **keywords):
    """An environment that only the horizon ends."""
    return CaptureVectorEnv(
        env_id, n, autoreset_mode="disabled", attitude_limit=179.9, hold_time=1e3, **keywords
    )


def random_actions(env, seed, steps=200, hold=5):
    """Random actions, each held; full strokes in the second half, which reach every limit."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(-1, 1, (-(-steps // hold), *env.action_space.shape))
    actions = np.repeat(drawn, hold, axis=0)[:steps]
    actions[steps // 2 :] = np.sign(actions[steps // 2 :])
    return actions


@pytest.mark.parametrize("hold", [1, 5, 20, 30])  # long holds bring the arm to full speed and to its stops
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("mode", CONTROL_MODES)
@pytest.mark.parametrize("env_id", IDS)
def test_total_momentum_drifts_at_most_1e_6_of_what_a_body_carried(env_id, mode, variant, hold):
    env = endless(env_id, 64, control_mode=mode, variant=variant)
    env.reset(seed=1)
    actions = random_actions(env, 1, hold=hold)
    qpos, qvel, torques = recorded(env, np.sign(actions) if hold > 5 else actions)
    motion = body_motion(env.task.robot, qpos, qvel)
    assert np.linalg.norm(motion.linear, axis=-1).max() > 2.0  # the arm really moved
    assert momentum_drift(motion)[1].max() <= 1e-6
    limits = env.task.robot.range + STOP_MARGIN * np.array([1, -1])
    overshoot = np.maximum(limits[:, 0] - qpos[..., 7:], qpos[..., 7:] - limits[:, 1])
    assert overshoot.max() < 0.8 * STOP_MARGIN  # nothing ever touches the end of a joint's range
    assert np.abs(qvel[..., 6:]).max() < 1.1 * SINGLE_ARM.rate_limit
    assert np.abs(torques).max() <= SINGLE_ARM.torque_limit


def test_momentum_audit_agrees_with_mujoco():
    env = endless(n=3)
    env.reset(seed=0)
    actions = random_actions(env, 0, 50)
    qpos, qvel, _ = recorded(env, actions)
    qvel[..., :6] += np.random.default_rng(0).normal(size=6)  # any motion, not only momentum-free ones
    motion = body_motion(env.task.robot, qpos, qvel)
    model = env.task.model
    data = mujoco.MjData(model)
    root = model.body("satellite").id
    for row, step in ((0, 3), (1, 30), (2, 50)):
        data.qpos[:], data.qvel[:] = qpos[row, step], qvel[row, step]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_subtreeVel(model, data)
        linear = model.body_subtreemass[root] * data.subtree_linvel[root]
        angular = data.subtree_angmom[root] + np.cross(data.subtree_com[root], linear)
        np.testing.assert_allclose(motion.total[row, step], [*linear, *angular], atol=1e-9)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        energy = 0.5 * data.qvel @ mass @ data.qvel
        assert motion.kinetic_energy[row, step] == pytest.approx(energy, rel=1e-10)
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, root, velocity, 0)
        turn = data.ximat[root].reshape(3, 3)
        spin = turn @ np.diag(model.body_inertia[root]) @ turn.T @ velocity[:3]
        np.testing.assert_allclose(motion.base_spin[row, step], spin, atol=1e-9)


@pytest.mark.parametrize("variant", VARIANTS)
def test_joint_velocity_servo_tracks_a_minimum_jerk_motion(variant):
    env = endless(variant=variant, difficulty="hard")
    env.reset(seed=0)
    robot = env.task.robot
    goal = robot.home + np.random.default_rng(1).uniform(-1.0, 1.0, (16, 7))
    q, qdot, _ = minimum_jerk(robot.home, goal, 10.0, 101)
    actions = (
        qdot[:, 1:].swapaxes(0, 1) / SINGLE_ARM.rate_limit
    )  # the rate to reach at the end of each period
    qpos, qvel, torques = recorded(env, actions)
    peak = np.abs(qdot).max(axis=(1, 2))
    error = np.abs(qvel[..., 6:] - qdot).max(axis=(1, 2))
    assert (error <= 0.01 * peak).all()
    assert np.abs(torques).max() < SINGLE_ARM.torque_limit
    # The base goes where momentum alone says it goes.
    fine_q, fine_rate, dt = minimum_jerk(robot.home, goal, 10.0, 1001)
    position, quaternion = roll_out_base(robot, fine_q, fine_rate, dt)
    distance = np.linalg.norm(qpos[..., :3] - position[:, ::10], axis=-1)
    angle = np.rad2deg(angle_between(qpos[..., 3:7], quaternion[:, ::10]))
    assert distance.max() <= 1e-3
    assert angle.max() <= 0.05


def test_joint_torque_is_applied_as_commanded_within_the_limits():
    env = endless(control_mode="joint_torque")
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-0.02, 0.02, (20, *env._action_shape))
    *_, torques = recorded(env, action)
    np.testing.assert_allclose(torques, action.swapaxes(0, 1) * SINGLE_ARM.torque_limit, atol=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_end_effector_velocity_reaches_the_commanded_twist(seed):
    env = endless(n=1, control_mode="end_effector_velocity")
    env.reset(seed=0)
    rng = np.random.default_rng(seed)
    command = rng.normal(size=6)
    command *= 0.1 / np.abs(command).max()  # slow enough for every joint, whatever the direction
    for _ in range(15):
        observation, *_ = env.step(command[None])
    read = env.task.layout.read
    reached = [read(observation, f"end_effector_{kind}_velocity")[0] for kind in ("linear", "angular")]
    wanted = command * env.mode.scale
    # Damping trades a few percent near singularities; the direction and size are those asked for.
    assert np.linalg.norm(np.concatenate(reached) - wanted) < 0.1 * np.linalg.norm(wanted)


@pytest.mark.parametrize("variant", VARIANTS)
def test_reactionless_mode_keeps_the_attitude_under_any_action(variant):
    env = endless(control_mode="reactionless", variant=variant)
    env.reset(seed=2)
    free = endless(control_mode="joint_velocity", variant=variant)
    free.reset(seed=2)
    peaks = []
    for each in (env, free):
        actions = random_actions(each, 3)
        peak = 0.0
        for action in actions:
            *_, info = each.step(action)
            peak = max(peak, info["attitude"].max())
        peaks.append(peak)
        assert np.abs(each.simulation.joint_position - each.task.robot.home).max() > 0.3
    assert peaks[0] <= 0.05
    assert peaks[1] > 100 * peaks[0]


def test_other_masses_of_the_ood_split_are_simulated_and_audited():
    env = endless(split="ood")
    env.reset(seed=0, options={"split": "ood", "index": np.arange(16)})
    scale = env.task.goals("ood", np.arange(16)).mass_scale
    qpos, qvel, _ = recorded(env, random_actions(env, 0, 60))
    drift = momentum_drift(body_motion(env.task.robot, qpos, qvel, scale[:, None]))[0]
    assert drift.max() < 1e-5
    # Audited with the nominal mass, the same motion seems to make momentum out of nothing.
    assert momentum_drift(body_motion(env.task.robot, qpos, qvel))[0].min() > 1e-2
