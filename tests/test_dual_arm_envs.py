"""The dual-arm environments: momentum and attitude, the tumbling target, captures, observations."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from dual_arm_goals import IDS, along, docked
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import space_envs  # noqa: F401  (registers the ids)
from space_envs.dynamics.bodies import body_motion
from space_envs.dynamics.rigid_body import point_motion, tumble
from space_envs.dynamics.rotations import Array, angle_between, exponential, rotate
from space_envs.envs import CaptureVectorEnv

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
every_id = pytest.mark.parametrize("env_id", IDS)


def make(env_id: str, n: int = 1, **keywords) -> CaptureVectorEnv:
    """An environment whose episodes freeze when they end."""
    return CaptureVectorEnv(env_id, n, autoreset_mode="disabled", **keywords)


def filled(env, value):
    """An action all of whose entries are the same."""
    return np.full(env.action_space.shape, value)


def vectors(values: Array, width: int) -> Array:
    """Vectors (N, k, 3) of a field (N, k * width)."""
    out = np.zeros((len(values), values.shape[1] // width, 3))
    out[..., :width] = values.reshape(len(values), -1, width)
    return out


# Mode reactionless ------------------------------------------------------------------------------------


@every_id
def test_no_action_turns_the_satellite_in_mode_reactionless(env_id):
    # How long an action is held, whether it is a full stroke, and the largest turn in deg of eight rows each.
    cases = ((1, False, 0.003), (1, True, 0.005), (20, True, 0.03), (60, True, 0.05))
    env = make(env_id, 32, control_mode="reactionless", hold_time=1e3, collisions=False)
    env.reset(seed=4)
    start, steps = env.simulation.joint_position.copy(), env.task.horizon
    shape = (steps, 8, env.action_space.shape[1])
    parts = [
        np.repeat(np.random.default_rng(hold).uniform(-1, 1, shape), hold, 0)[:steps] for hold, *_ in cases
    ]
    parts = [np.sign(part) if full else part for part, (_, full, _) in zip(parts, cases, strict=True)]
    peak, moved, momentum = np.zeros(32), np.zeros(32), 0.0
    for action in np.concatenate(parts, axis=1):
        *_, info = env.step(action)
        peak = np.maximum(peak, info["attitude"])
        total = body_motion(env.task.mechanics, *env.simulation.robot_state()).total
        momentum = max(momentum, np.abs(total).max())
        moved = np.maximum(moved, np.abs(env.simulation.joint_position - start).max(axis=1))
    assert (info["outcome"] == "timeout").all()
    assert (moved.reshape(4, 8).max(axis=1) > 0.5).all()
    assert (peak.reshape(4, 8).max(axis=1) <= [largest for *_, largest in cases]).all()  # promised is 0.1
    assert momentum <= 1e-6  # N s, N m s


@every_id
def test_reactionless_mode_with_a_mass_that_it_does_not_know(env_id):
    env = make(env_id, 16, control_mode="reactionless", hold_time=1e3, collisions=False)
    env.reset(seed=0, options={"split": "ood", "index": np.arange(16)})
    rng, peak = np.random.default_rng(0), 0.0
    for _ in range(env.task.horizon):
        *_, info = env.step(rng.uniform(-1, 1, env.action_space.shape))
        peak = max(peak, info["attitude"].max())
    assert 1e-4 < peak < 0.1


# The target -------------------------------------------------------------------------------------------


def test_tumbling_is_that_of_eulers_equations():
    rng = np.random.default_rng(0)
    inertia = np.array([12.0, 16.0, 20.0])
    quaternion, spin = exponential(rng.normal(size=3)), rng.normal(size=3)
    times = np.array([0.0, 3.0, 10.0])

    def rate(_, state):
        q, w = state[:4], state[4:]
        moved = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
        return np.concatenate([moved, np.cross(inertia * w, w) / inertia])

    local = Rotation.from_quat(quaternion, scalar_first=True).inv().apply(spin)
    found = solve_ivp(rate, (0, 10), [*quaternion, *local], t_eval=times, rtol=1e-11, atol=1e-12).y.T
    attitude, velocity = tumble(quaternion, spin, inertia, times)
    assert angle_between(attitude, found[:, :4]).max() < 1e-5
    expected = Rotation.from_quat(found[:, :4], scalar_first=True).apply(found[:, 4:])
    np.testing.assert_allclose(velocity, expected, atol=1e-5)
    # Backwards it is undone.
    back, before = tumble(attitude[-1], velocity[-1], inertia, np.array([-10.0]))
    assert angle_between(back[0], quaternion) < 1e-5
    np.testing.assert_allclose(before[0], spin, atol=1e-5)


@every_id
def test_the_target_tumbles_freely_whatever_the_arms_do(env_id):
    env = make(env_id, 3, difficulty="hard", hold_time=1e3, collisions=False)
    observation, _ = env.reset(seed=1)
    task, read = env.task, env.task.layout.read
    planar, inertia = task.kind == "planar", np.array(task.target.inertia)
    seen, rng = [observation], np.random.default_rng(0)
    for _ in range(150):
        seen.append(env.step(rng.uniform(-1, 1, env.action_space.shape))[0])
    record = np.stack(seen)
    place = read(record, "target_position")
    np.testing.assert_allclose(place, np.broadcast_to(place[0], place.shape), atol=1e-12)
    times = read(record, "time")[:, 0, 0]
    spin = read(record, "target_angular_velocity")
    if planar:
        np.testing.assert_allclose(spin, np.broadcast_to(spin[0], spin.shape), atol=1e-12)
        angle = read(record, "target_angle")
        np.testing.assert_allclose(angle, angle[0] + times[:, None, None] * spin[0], atol=1e-9)
        return
    quaternion = read(record, "target_quaternion")
    local = rotate(quaternion * [1, -1, -1, -1], spin)
    momentum, energy = rotate(quaternion, inertia * local), 0.5 * (inertia * local**2).sum(axis=-1)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-9)
    np.testing.assert_allclose(energy, np.broadcast_to(energy[0], energy.shape), rtol=1e-9)
    assert np.ptp(spin, axis=0).max() > 1e-5  # three different moments: the axis wanders
    attitude, velocity = tumble(quaternion[0], spin[0], inertia, times)
    assert angle_between(attitude.swapaxes(0, 1), quaternion).max() < 1e-7
    np.testing.assert_allclose(velocity.swapaxes(0, 1), spin, atol=1e-8)


@every_id
def test_grapples_move_with_the_target_and_lie_where_its_size_says(env_id):
    env = make(env_id, 4, hold_time=1e3)
    task, read = env.task, env.task.layout.read
    planar = task.kind == "planar"
    width = 2 if planar else 3
    centre = task.robot.target.position[:width]
    spin = [0.3] if planar else [0.1, -0.2, 0.3]
    sizes = np.array([[0.2], [0.3], [0.35], [0.4]])
    options = {"target_position": centre, "target_angular_velocity": spin, "target_half_width": sizes}
    observation, _ = env.reset(seed=0, options=options)
    for _ in range(12):
        turn = np.zeros((4, 3))
        turn[:, 2:] = read(observation, "target_angle") if planar else 0.0
        attitude = exponential(turn) if planar else read(observation, "target_quaternion")
        w = np.zeros((4, 3))
        w[:, 2 if planar else 0 :] = read(observation, "target_angular_velocity")
        at = np.zeros((4, 3))
        at[:, :width] = read(observation, "target_position")
        # Arm 1 has the point at -y of the planar target, at +x of the spatial one.
        for arm, sign in ((0, 1.0), (1, -1.0)):
            point = np.zeros((4, 3))
            point[:, 1 if planar else 0] = sign * (-1.0 if planar else 1.0) * sizes[:, 0]
            position, velocity = point_motion(at, attitude, w, point)
            found = vectors(read(observation, "goal_position"), width)[:, arm]
            np.testing.assert_allclose(found, position, atol=1e-12)
            moving = vectors(read(observation, "goal_linear_velocity"), width)[:, arm]
            np.testing.assert_allclose(moving, velocity, atol=1e-12)
            if not planar:
                way = rotate(attitude, np.array([-sign, 0.0, 0.0]))
                found = vectors(read(observation, "goal_axis"), 3)[:, arm]
                np.testing.assert_allclose(found, way, atol=1e-12)
        observation, *_ = env.step(filled(env, 0.0))


@every_id
def test_a_row_keeps_its_target_when_others_get_new_ones(env_id):
    env = make(env_id, 3)
    observation, _ = env.reset(seed=0)
    mask = np.array([False, True, False])
    again, _ = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(again[~mask], observation[~mask])
    spread = env.simulation.batch.expanded("site_pos")
    assert spread is not None
    after, *_ = env.step(filled(env, 0.0))
    goal = vectors(env.task.layout.read(after, "goal_position"), 2 if env.simulation.planar else 3)
    widths = 0.5 * np.linalg.norm(goal[:, 0] - goal[:, 1], axis=-1)
    np.testing.assert_allclose(widths[~mask], env.task.goals("train", env.episodes.index).half_width[~mask])
    assert len(set(widths.round(9))) == 3


# Captures ---------------------------------------------------------------------------------------------


def ends(env_id, steps=12, keywords=None, **changes):
    """Whether the episode ended in a capture after each step of rest, and the capture errors at its start."""
    env = gym.make(env_id, **(keywords or {}))
    task = env.unwrapped.task
    observation, _ = env.reset(options=docked(task, **changes))
    errors = task.errors(observation[None])
    over = []
    for _ in range(steps):
        *_, terminated, _, info = env.step(filled(env, 0.0))
        over.append(terminated)
        assert info["is_success"] == terminated == (info["outcome"] == "captured")
        if terminated:
            assert info["reward_terms"]["capture"] == pytest.approx(10.0, abs=1e-6)  # at rest
            break
    return over, errors


@every_id
def test_both_at_their_grapple_points_for_the_hold_time_is_a_capture(env_id):
    over, errors = ends(env_id)
    np.testing.assert_allclose(errors[:3], 0.0, atol=1e-6 if "Planar" in env_id else 0.2)
    assert errors.position < 1e-9
    assert over == [False] * 9 + [True]
    assert ends(env_id, 5, {"hold_time": 0.3})[0] == [False, False, True]
    assert ends(env_id, 25, {"hold_time": 2.0})[0] == [False] * 19 + [True]


@every_id
def test_one_end_effector_off_is_no_capture(env_id):
    task = gym.make(env_id).unwrapped.task
    direction = along(task, docked(task))
    through = {"collisions": False}  # a target that is moved so far, or is so large, touches a link in space
    for off, captured in ((0.0245, True), (0.0255, False)):
        for sign in (1.0, -1.0):
            # One grapple point moves by twice as much, the other stays where its end-effector is.
            moved = {"target_position": sign * off * direction, "target_half_width": [off]}
            over, errors = ends(env_id, 12, through, **moved)
            assert errors.position == pytest.approx(2 * off, abs=1e-9)
            assert any(over) == captured
            assert any(ends(env_id, 12, {"position_tolerance": 0.03}, target_position=off * direction)[0])
    tight, wide = ({"position_tolerance": at, **through} for at in (0.03, 0.07))
    assert not any(ends(env_id, 12, tight, target_position=0.031 * direction)[0])
    assert any(ends(env_id, 12, wide, target_position=0.069 * direction)[0])


@every_id
def test_a_grapple_point_that_moves_away_too_fast_is_no_capture(env_id):
    planar = "Planar" in env_id
    task = gym.make(env_id).unwrapped.task
    width = docked(task)["target_half_width"][0]
    for speed, tolerance, captured in ((0.009, 0.01, True), (0.011, 0.01, False), (0.011, 0.05, True)):
        spin = [speed / width] if planar else [0.0, 0.0, speed / width]
        keywords = {"linear_velocity_tolerance": tolerance}
        over, errors = ends(env_id, 12, keywords, target_angular_velocity=spin)
        # Across the line between the points, or in space nearly so.
        assert errors.linear_velocity == pytest.approx(speed, rel=1e-9 if planar else 0.1)
        assert any(over) == captured


def test_in_space_the_approach_axis_counts_too():
    env_id = IDS[1]
    aligned = ends(env_id)[1].orientation
    assert aligned < np.deg2rad(0.3)  # what the roll-out behind the posture leaves
    for degrees, tolerance, captured in (
        (4.0, 5.0, True),
        (6.0, 5.0, False),
        (6.0, 7.0, True),
        (2, 1.0, False),
    ):
        keywords = {"approach_tolerance": tolerance, "position_tolerance": 0.2}
        over, errors = ends(env_id, 12, keywords, target_turn=np.deg2rad(degrees))
        assert np.rad2deg(errors.orientation) == pytest.approx(degrees, abs=0.5)
        assert any(over) == captured


def test_in_the_plane_no_angle_counts():
    _, errors = ends(IDS[0], target_turn=np.deg2rad(6.0))
    assert errors.orientation == 0.0
    assert any(ends(IDS[0], target_turn=np.deg2rad(6.0))[0])


# Observations -----------------------------------------------------------------------------------------


def expected(env: CaptureVectorEnv, row: int) -> dict[str, Array]:
    """Every measured field of the observation, from MuJoCo's own quantities."""
    model, simulation = env.task.model, env.simulation
    data = simulation.batch.get_data(row)
    model_row = mujoco.MjModel.__copy__(model)
    sites = simulation.batch.expanded("site_pos")
    assert sites is not None
    model_row.site_pos[:] = sites[row]
    mujoco.mj_setState(model_row, data, simulation.state(row), STATE)
    mujoco.mj_forward(model_row, data)
    planar = simulation.planar
    flat = slice(0, 2) if planar else slice(0, 3)

    def moving(kind, name):
        out = np.zeros(6)
        index = (model.site if kind == mujoco.mjtObj.mjOBJ_SITE else model.body)(name).id
        mujoco.mj_objectVelocity(model_row, data, kind, index, out, 0)
        return out  # angular, then linear

    body, site = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE
    turn = slice(2, 3) if planar else slice(0, 3)
    values = {
        "joint_position": simulation.joint_position[row],
        "joint_velocity": simulation.joint_velocity[row],
        "base_position": data.body("satellite").xpos[flat],
        "base_linear_velocity": moving(body, "satellite")[3:][flat],
        "base_angular_velocity": moving(body, "satellite")[:3][turn],
        "target_position": data.body("target").xpos[flat],
        "target_angular_velocity": moving(body, "target")[:3][turn],
    }
    for name, of in (("base", "satellite"), ("target", "target")):
        if planar:
            matrix = data.body(of).xmat.reshape(3, 3)
            values[f"{name}_angle"] = np.array([np.arctan2(matrix[1, 0], matrix[0, 0])])
        else:
            values[f"{name}_quaternion"] = data.body(of).xquat
    for name, of in (("end_effector", "end_effector"), ("goal", "grapple")):
        each = [data.site(f"{of}{arm}") for arm in (1, 2)]
        values[f"{name}_position"] = np.concatenate([s.xpos[flat] for s in each])
        values[f"{name}_linear_velocity"] = np.concatenate(
            [moving(site, f"{of}{arm}")[3:][flat] for arm in (1, 2)]
        )
        if not planar:
            values[f"{name}_axis"] = np.concatenate([s.xmat.reshape(3, 3)[:, 2] for s in each])
    values["position_error"] = values["goal_position"] - values["end_effector_position"]
    values["velocity_error"] = values["goal_linear_velocity"] - values["end_effector_linear_velocity"]
    return values


@every_id
def test_observations_are_what_mujoco_says(env_id):
    env = make(env_id, 3, difficulty="hard", attitude_limit=170.0)
    env.reset(seed=2)
    rng = np.random.default_rng(1)
    for _ in range(40):
        observation, *_ = env.step(rng.uniform(-1, 1, env.action_space.shape))
    layout = env.task.layout
    for row in range(3):
        values = expected(env, row)
        for name, value in values.items():
            found = layout.read(observation[row], name)
            if name.endswith("angle"):
                found = np.arctan2(np.sin(found), np.cos(found))
            np.testing.assert_allclose(found, value, atol=1e-9, err_msg=name)
        assert layout.read(observation[row], "time") == pytest.approx(4.0)
        left = {field.name for field in layout.fields} - set(values) - {"time", "peak_attitude"}
        assert left == ({"axis_error"} if "Spatial" in env_id else set())


@every_id
def test_errors_change_as_the_velocity_errors_say(env_id):
    env = make(env_id, 4, control_period=0.01, timestep=0.01, difficulty="hard")
    observation, _ = env.reset(seed=3)
    read, seen = env.task.layout.read, [observation]
    action = np.random.default_rng(0).uniform(-1, 1, env.action_space.shape)
    for _ in range(30):
        seen.append(env.step(action)[0])
    record = np.stack(seen)
    change = np.diff(read(record, "position_error"), axis=0)
    rate = read(record, "velocity_error")
    np.testing.assert_allclose(change, 0.005 * (rate[1:] + rate[:-1]), atol=2e-7)
    assert np.abs(change).max() > 1e-3


def test_axis_errors_turn_the_approach_axes_onto_the_ways_in():
    env = make(IDS[1], 8, difficulty="hard")
    observation, _ = env.reset(seed=5)
    for _ in range(20):
        observation, *_ = env.step(np.random.default_rng(2).uniform(-1, 1, env.action_space.shape))
    error, axis, way = (
        vectors(env.task.layout.read(observation, name), 3)
        for name in ("axis_error", "end_effector_axis", "goal_axis")
    )
    np.testing.assert_allclose(rotate(exponential(error), axis), way, atol=1e-12)
    np.testing.assert_allclose((error * axis).sum(axis=-1), 0.0, atol=1e-12)  # the short way, no roll
    worst = np.linalg.norm(error, axis=-1).max(axis=-1)
    np.testing.assert_allclose(env.task.errors(observation).orientation, worst, atol=1e-12)


@every_id
def test_reward_terms_are_of_the_worst_end_effector(env_id):
    env = gym.make(env_id, position_tolerance=0.04, linear_velocity_tolerance=0.02)
    task = env.unwrapped.task
    start, _ = env.reset(seed=0)
    action = filled(env, 0.3)
    observation, reward, *_, info = env.step(action)
    terms, width = info["reward_terms"], 2 if task.kind == "planar" else 3
    field = lambda name: vectors(task.layout.read(observation[None], name), width)[0]  # noqa: E731
    position, speed = (
        np.linalg.norm(field(name), axis=-1).max() for name in ("position_error", "velocity_error")
    )
    errors = task.errors(observation[None])
    np.testing.assert_allclose(
        [errors.position, errors.linear_velocity, errors.angular_velocity],
        [[position], [speed], [0.0]],
        atol=1e-12,
    )
    before = task.errors(start[None])
    assert terms["position"] == pytest.approx(-0.5 * (position - before.position[0]))
    assert terms["effort"] == pytest.approx(-0.1 * 0.02 * 0.09)
    ratio, ratio_before = position / 0.04, before.position[0] / 0.04
    if task.kind == "spatial":
        angle = np.linalg.norm(field("axis_error"), axis=-1).max()
        assert terms["orientation"] == pytest.approx(-0.25 * (angle - before.orientation[0]))
        ratio = max(ratio, angle / np.deg2rad(5.0))
        ratio_before = max(ratio_before, before.orientation[0] / np.deg2rad(5.0))
    assert terms["precision"] == pytest.approx(0.5 * (np.exp(-ratio) - np.exp(-ratio_before)))
    assert ("orientation" in terms) == (task.kind == "spatial")
    assert reward == pytest.approx(sum(terms.values()), abs=1e-12)
