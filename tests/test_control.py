"""Control modes: momentum, tracking, limits, what each action means, and the recorded metrics' physics."""

import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from space_envs.control import CONTROL_MODES
from space_envs.drives import BRAKING_SHARE, STOP_MARGIN, braking_deceleration
from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.envs.braking import braking_load
from space_envs.errors import ConfigurationError
from space_envs.registration import ENTRIES, make_task
from space_envs.robots.robot import StepLimits
from space_envs.robots.zoo import find_robot
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.single_arm import SingleArmTask

# Every id in every variant that it has: a name for tests, the id and its keywords.
ROBOTS = {f"SingleArm-{variant}": {"variant": variant} for variant in ("paper", "physical")}
ROBOTS |= {name: {} for name in ("DualArmPlanar", "DualArmSpatial")}
SAME = {"SingleArmCluttered"}  # the robot of SingleArm, in episodes that collisions end; it has its own tests
HOLDS = (1, 5, 20, 30)  # control steps; long holds bring the arm to full speed and to its stops


def test_every_id_is_here():
    ids = {name.split("/")[1].split("-")[0] for name in ENTRIES}
    assert ids == SAME | {name.split("-")[0] for name in ROBOTS}


def recorded(env, actions):
    """qpos (N, T + 1, 7 + n), qvel, torques (N, T, n) along actions (T, N, m) from the present state."""
    simulation, states, torques = env.simulation, [], []
    for action in actions:
        states.append(simulation.robot_state())
        env.step(action)
        torques.append(simulation.ctrl.copy())
    states.append(simulation.robot_state())
    qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
    return qpos, qvel, np.stack(torques, axis=1)


def endless(name, n=16, **keywords):
    """An environment that only the horizon ends."""
    return CaptureVectorEnv(
        f"SpaceCapture/{name.split('-')[0]}-v0",
        n,
        autoreset_mode="disabled",
        attitude_limit=179.9,
        hold_time=1e3,
        collisions=False,
        **ROBOTS[name],
        **keywords,
    )


def random_actions(env, seed, steps=200, hold=5):
    """Random actions, each held; full strokes in the second half, which reach every limit."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(-1, 1, (-(-steps // hold), *env.action_space.shape))
    actions = np.repeat(drawn, hold, axis=0)[:steps]
    actions[steps // 2 :] = np.sign(actions[steps // 2 :])
    return actions


def every_hold(env, seed):
    """Random actions of a whole episode, held for as long as `HOLDS` says by row in turn."""
    actions = np.empty((env.task.horizon, *env.action_space.shape))
    for part, hold in enumerate(HOLDS):
        drawn = random_actions(env, seed + part, env.task.horizon, hold)
        actions[:, part :: len(HOLDS)] = (np.sign(drawn) if hold > 5 else drawn)[:, part :: len(HOLDS)]
    return actions


@cache
def whole_episode(name, mode, n=32):
    """The environment, and what was recorded of a whole episode of random actions."""
    env = endless(name, n, control_mode=mode)
    env.reset(seed=1)
    return env, *recorded(env, every_hold(env, 1))


@pytest.mark.parametrize("n", [32, pytest.param(256, marks=pytest.mark.slow)])
@pytest.mark.parametrize("mode", CONTROL_MODES)
@pytest.mark.parametrize("name", ROBOTS)
def test_total_momentum_drifts_at_most_1e_6_of_what_a_body_carried(name, mode, n):
    env, qpos, qvel, torques = whole_episode(name, mode, n)
    motion = body_motion(env.task.mechanics, qpos, qvel)
    assert np.linalg.norm(motion.linear, axis=-1).max() > 2.0  # the arm really moved
    assert momentum_drift(motion)[1].max() <= 1e-6
    limits = env.task.mechanics.range + STOP_MARGIN * np.array([1, -1])
    overshoot = np.maximum(limits[:, 0] - qpos[..., 7:], qpos[..., 7:] - limits[:, 1])
    assert overshoot.max() < 0.8 * STOP_MARGIN  # nothing ever touches the end of a joint's range
    # Within 5 % nearly always; Coriolis forces at full strokes rarely leave a drive too little torque.
    assert (np.abs(qvel[..., 6:]) < 1.2 * env.task.robot.rate_limit).all()
    assert (np.abs(torques) <= env.task.robot.torque_limit).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_reactionless_mode_keeps_the_attitude_under_any_action(name):
    peaks, momentum = [], []
    for mode in ("reactionless", "joint_velocity"):
        env, qpos, qvel, _ = whole_episode(name, mode)
        still = np.array([1.0, 0.0, 0.0, 0.0])
        peaks.append(np.rad2deg(angle_between(qpos[..., 3:7], still)).max())
        momentum.append(np.abs(body_motion(env.task.mechanics, qpos, qvel).total).max())
        assert np.abs(qpos[:, -1, 7:] - qpos[:, 0, 7:]).max() > 0.3
    assert peaks[0] <= 0.05  # README says so
    assert peaks[1] > 100 * peaks[0]
    if name.startswith("Dual"):
        assert momentum[0] <= 1e-6  # N s, N m s


def assert_kept(env, qpos, qvel, factor=None):
    """Momentum as promised, no joint at the end of its range, and rates near their limit at most."""
    motion = body_motion(env.task.mechanics, qpos, qvel, factor)
    assert momentum_drift(motion)[1].max() <= 1e-6
    limits = env.task.mechanics.range
    assert np.minimum(qpos[..., 7:] - limits[:, 0], limits[:, 1] - qpos[..., 7:]).min() > 0.0
    assert (np.abs(qvel[..., 6:]) < 1.2 * env.task.robot.rate_limit).all()


@pytest.mark.parametrize("mode", CONTROL_MODES)
@pytest.mark.parametrize("name", ROBOTS)
def test_the_promise_holds_at_the_largest_control_period_and_step(name, mode):
    task = make_task(f"SpaceCapture/{name.split('-')[0]}-v0", ROBOTS[name])
    steps = task.robot.steps
    longest = {"control_period": steps.largest_control_period, "timestep": steps.largest_timestep}
    env = endless(name, 8, control_mode=mode, horizon=50, **longest)
    env.reset(seed=0)
    qpos, qvel, _ = recorded(env, every_hold(env, 2))
    assert (np.abs(qvel[..., 6:]) > 0.5 * task.robot.rate_limit).any()
    assert_kept(env, qpos, qvel)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(
    ("keyword", "factor", "largest"),
    [("control_period", 1.5, "largest_control_period"), ("timestep", 2.0, "largest_timestep")],
)
def test_what_was_not_shown_to_work_is_refused_with_the_largest_that_does(name, keyword, factor, largest):
    bound = getattr(make_task(f"SpaceCapture/{name.split('-')[0]}-v0", ROBOTS[name]).robot.steps, largest)
    for value in (factor * bound, 1.0, 1e6):
        with pytest.raises(ConfigurationError, match=f"{keyword} must .*{bound:g} s"):
            endless(name, 1, **{keyword: value})
    with pytest.raises(ConfigurationError, match=r"timestep must lie in 0\.0001"):
        endless(name, 1, timestep=1e-9)


def test_the_default_control_period_is_one_that_the_drives_of_the_robot_allow():
    robot = find_robot("shyam2020")
    for longest, period in ((0.16, 0.1), (0.05, 0.04), (0.02, 0.02)):
        slower = replace(robot, steps=StepLimits(0.02, 0.02, longest))
        task = SingleArmTask(robot=slower)
        assert task.control_period == pytest.approx(period, rel=1e-15)
        with pytest.raises(ConfigurationError, match=f"at most {longest:g} s"):
            SingleArmTask(robot=slower, control_period=2 * longest)
        with pytest.raises(ConfigurationError, match="to 0.02 s"):
            SingleArmTask(robot=slower, timestep=0.025)


# From these angles and rates, each within the braking law of its joint, the arm cannot be braked.
TOGETHER = (
    [-0.7193, 2.1764, 2.8084, -0.3061, 0.2441, -0.6957, 1.0149],
    [-0.2997, -0.2997, 0.0855, -0.2997, 0.2997, 0.2997, -0.2997],
)


def fast_starts(env, seed, goals):
    """Joint angles and rates (N, n) as near to their stops, and as fast, as the drives can brake.

    Every third row has joints anywhere in their ranges.
    """
    rng, limits = np.random.default_rng(seed), env.task.mechanics.range
    shape = (env.num_envs, len(limits))
    middle = 0.5 * (limits[:, 1] - limits[:, 0]) - STOP_MARGIN
    anywhere = (np.arange(env.num_envs) % 3 == 0)[:, None]
    room = np.minimum(rng.uniform(0.0, np.where(anywhere, 2.0 * middle, 1.3), shape), middle)
    upper = rng.random(shape) < 0.5
    position = np.where(upper, limits[:, 1] - STOP_MARGIN - room, limits[:, 0] + STOP_MARGIN + room)
    fastest = np.minimum(
        np.sqrt(2.0 * braking_deceleration(env.task.robot) * room), env.task.robot.rate_limit
    )
    velocity = np.where(upper, fastest, -fastest) * np.where(rng.random(shape) < 0.2, rng.random(shape), 1.0)
    load = braking_load(env.task, replace(goals, joint_position=position), velocity).max(axis=1)[:, None]
    return position, (1.0 - 1e-9) * velocity * np.minimum(np.sqrt(BRAKING_SHARE / load), 1.0)


@pytest.mark.parametrize("mode", CONTROL_MODES)
@pytest.mark.parametrize("name", ROBOTS)
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=1, deadline=None)
def test_any_start_that_is_accepted_keeps_momentum_under_any_action(name, mode, seed):
    env = endless(name, 96, control_mode=mode)
    index = np.arange(96)
    goals = env.task.goals("ood", index)
    position, velocity = fast_starts(env, seed, goals)
    options = {"split": "ood", "index": index, "joint_position": position, "joint_velocity": velocity}
    env.reset(seed=0, options=options)
    outward = np.resize(np.sign(velocity), env.action_space.shape)
    kind = np.arange(96)[:, None] % 4  # no action, outwards, and random ones
    drawn = random_actions(env, seed, 16, 3)
    qpos, qvel, _ = recorded(env, np.where(kind == 0, 0.0, np.where(kind == 1, outward, drawn)))
    assert_kept(env, qpos, qvel, env.simulation.mass_factor[:, None])


@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_joints_too_fast_together_are_refused_and_the_rates_named_instead_can_be_braked(mode):
    env = endless("SingleArm-paper", 1, control_mode=mode)
    position, velocity = TOGETHER
    with pytest.raises(ConfigurationError, match="to brake all joints together takes") as refused:
        env.reset(seed=0, options={"joint_position": position, "joint_velocity": velocity})
    found = re.search(r"the same rates times ([0-9.]+) are accepted", str(refused.value))
    assert found
    for factor, accepted in ((float(found[1]), True), (float(found[1]) + 0.002, False)):
        slower = {"joint_position": position, "joint_velocity": factor * np.array(velocity)}
        if not accepted:
            with pytest.raises(ConfigurationError, match="to brake all joints together takes"):
                env.reset(seed=0, options=slower)
            continue
        env.reset(seed=0, options=slower)
        qpos, qvel, _ = recorded(env, np.zeros((40, *env.action_space.shape)))
        assert_kept(env, qpos, qvel)


@pytest.mark.parametrize("name", ROBOTS)
def test_starts_that_cannot_brake_are_refused_before_anything_moves(name):
    env = endless(name, 2)
    env.reset(seed=0)
    before = env.simulation.qpos.copy()
    position, velocity = fast_starts(env, 0, env.task.goals("train", np.arange(2)))
    limits, fastest = env.task.mechanics.range, env.task.robot.rate_limit
    at_end, still, outward = position.copy(), np.zeros_like(velocity), np.zeros_like(velocity)
    at_end[1, 2], outward[1, 2] = limits[2, 1], fastest[1]  # the example that cost 2e-3 of momentum
    close, late = position.copy(), velocity.copy()
    close[0, 1] = limits[1, 0] + 0.5 * STOP_MARGIN
    position[1, 0], late[1, 0] = limits[0, 1] - STOP_MARGIN - 0.01, 1.02 * np.sqrt(2.0 * 0.04 * 0.01)
    for start, rate, message in (
        (at_end, outward, "joint 3 starts at"),
        (at_end, still, "the drives stop it 0.1 rad inside"),
        (close, still, "joint 2 starts at"),
        (position, late, r"joint_velocity outside its limits: joint 1 .* can brake .* to 0\.0282843 rad/s"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            env.reset(options={"joint_position": start, "joint_velocity": rate})
    np.testing.assert_array_equal(env.simulation.qpos, before)


@pytest.mark.parametrize("env_id", ENTRIES)
def test_every_goal_starts_inside_the_stops(env_id):
    for split in SPLITS:
        for difficulty in DIFFICULTIES:
            task = make_task(env_id, {"difficulty": difficulty})
            start, limits = task.goals(split, np.arange(64)).joint_position, task.mechanics.range
            assert (start > limits[:, 0] + STOP_MARGIN).all() and (start < limits[:, 1] - STOP_MARGIN).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_momentum_audit_agrees_with_mujoco(name):
    env = endless(name, 3)
    env.reset(seed=0)
    recorded(env, random_actions(env, 0, 50))
    simulation, model = env.simulation, env.task.model
    b = simulation.n_base
    robot = b + simulation.n_joints  # velocities of the robot; what follows them is the target's
    simulation.qvel[:, :b] += np.random.default_rng(0).normal(size=b)  # any motion, not only momentum-free
    simulation.refresh()
    motion = body_motion(env.task.mechanics, *simulation.robot_state())
    data = mujoco.MjData(model)
    root = model.body("satellite").id
    for row in range(3):
        mujoco.mj_setState(model, data, simulation.state(row), mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_subtreeVel(model, data)
        linear = model.body_subtreemass[root] * data.subtree_linvel[root]
        angular = data.subtree_angmom[root] + np.cross(data.subtree_com[root], linear)
        np.testing.assert_allclose(motion.total[row], [*linear, *angular], atol=1e-9)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        energy = 0.5 * data.qvel[:robot] @ mass[:robot, :robot] @ data.qvel[:robot]
        assert motion.kinetic_energy[row] == pytest.approx(energy, rel=1e-10)
        velocity = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, root, velocity, 0)
        turn = data.ximat[root].reshape(3, 3)
        spin = turn @ np.diag(model.body_inertia[root]) @ turn.T @ velocity[:3]
        np.testing.assert_allclose(motion.base_spin[row], spin, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_joint_velocity_servo_tracks_a_minimum_jerk_motion(name):
    env = endless(name, difficulty="hard")
    env.reset(seed=0)
    robot, limits = env.task.mechanics, env.task.robot
    start = env.simulation.joint_position.copy()
    goal = start + np.random.default_rng(1).uniform(-1.0, 1.0, start.shape)
    goal = np.clip(goal, robot.range[:, 0] + 0.3, robot.range[:, 1] - 0.3)
    q, qdot, _ = minimum_jerk(start, goal, 10.0, 101)
    actions = qdot[:, 1:].swapaxes(0, 1) / limits.rate_limit  # the rate to reach at the end of each period
    qpos, qvel, torques = recorded(env, actions)
    peak = np.abs(qdot).max(axis=(1, 2))
    error = np.abs(qvel[..., 6:] - qdot).max(axis=(1, 2))
    assert (error <= 0.01 * peak).all()
    assert (np.abs(torques) < limits.torque_limit).all()
    # The base goes where momentum alone says it goes.
    fine_q, fine_rate, dt = minimum_jerk(start, goal, 10.0, 1001)
    position, quaternion = roll_out_base(robot, fine_q, fine_rate, dt)
    distance = np.linalg.norm(qpos[..., :3] - position[:, ::10], axis=-1)
    angle = np.rad2deg(angle_between(qpos[..., 3:7], quaternion[:, ::10]))
    assert distance.max() <= 1e-3
    assert angle.max() <= 0.05


# A share of the torque limit that cannot make a joint too fast in a second, by what the links weigh.
@pytest.mark.parametrize(("name", "share"), list(zip(ROBOTS, (0.02, 0.01, 0.002, 0.001), strict=True)))
def test_joint_torque_is_applied_as_commanded_within_the_limits(name, share):
    env = endless(name, control_mode="joint_torque")
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-share, share, (20, *env.action_space.shape))
    *_, torques = recorded(env, action)
    limit = env.task.robot.torque_limit
    np.testing.assert_allclose(torques, action.swapaxes(0, 1) * limit, atol=1e-12)


def twists(env):
    """Twists [v; w] of the end-effectors of row 0 in inertial axes, as MuJoCo has them, one after the other.

    In the plane [vx, vy, wz].
    """
    simulation, model = env.simulation, env.task.model
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, simulation.state(0), mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_forward(model, data)
    found = []
    for site in range(model.nsite):
        if model.site(site).name.startswith("end_effector"):
            velocity = np.zeros(6)  # angular first
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 0)
            twist = np.concatenate([velocity[3:], velocity[:3]])
            found.append(twist[[0, 1, 5]] if simulation.planar else twist)
    return np.concatenate(found)


@pytest.mark.parametrize("name", ROBOTS)
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_end_effector_velocity_reaches_the_commanded_twist(name, seed):
    env = endless(name, 1, control_mode="end_effector_velocity")
    # Arms of three joints are soon stretched out, where there is no way on: they start with bent elbows.
    bent = {"joint_position": [-0.9, 1.5, 1.2, 1.4, -1.5, -1.2]} if name == "DualArmPlanar" else {}
    env.reset(seed=0, options=bent)
    robot, q = env.task.mechanics, env.simulation.joint_position[0]
    rows = [0, 1, 5] if env.simulation.planar else list(range(6))
    maps = [robot.generalized_jacobian(q, tip)[rows] for tip in range(len(robot.end_effector_link))]
    command = np.random.default_rng(seed).normal(size=env.mode.size)
    rates = np.linalg.pinv(np.concatenate(maps)) @ (command * env.mode.scale)
    command *= min(0.1 / np.abs(rates).max(), 0.1 / np.abs(command).max())  # slow enough for every joint
    for _ in range(15):
        env.step(command[None])
    wanted = command * env.mode.scale
    # Damping trades a few percent near singularities; the direction and size are those asked for.
    assert np.linalg.norm(twists(env) - wanted) < 0.1 * np.linalg.norm(wanted)


@pytest.mark.parametrize("name", ROBOTS)
def test_reactionless_mode_with_a_mass_that_the_model_does_not_have(name):
    """What README says of the split ood, whose masses are up to 20 % off."""
    env = endless(name, 32, control_mode="reactionless", split="ood")
    env.reset(seed=2, options={"split": "ood", "index": np.arange(32)})
    assert np.ptp(env.task.goals("ood", np.arange(32)).mass_scale) > 0.3
    qpos, _, _ = recorded(env, every_hold(env, 3))
    peak = np.rad2deg(angle_between(qpos[..., 3:7], np.array([1.0, 0.0, 0.0, 0.0]))).max()
    assert 0.01 < peak <= 0.3


@pytest.mark.parametrize("name", ROBOTS)
def test_other_masses_of_the_ood_split_are_simulated_and_audited(name):
    env = endless(name, split="ood")
    env.reset(seed=0, options={"split": "ood", "index": np.arange(16)})
    scale = env.task.goals("ood", np.arange(16)).mass_scale
    qpos, qvel, _ = recorded(env, random_actions(env, 0, 60))
    factor = env.simulation.mass_factor[:, None]
    np.testing.assert_array_equal(factor[:, 0, 0], scale)
    drift = momentum_drift(body_motion(env.task.mechanics, qpos, qvel, factor))[0]
    assert drift.max() < 1e-5
    # Audited with the nominal mass, the same motion seems to make momentum out of nothing.
    assert momentum_drift(body_motion(env.task.mechanics, qpos, qvel))[0].min() > 1e-2
