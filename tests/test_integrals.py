"""Integrals and largest values of an episode, taken at every step of the simulation."""

import mujoco
import numpy as np
import pytest
from rollouts import rollout_of

from space_envs.dynamics.rotations import angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.records.metrics import episode_metrics

SINGLE, PLANAR = "SpaceCapture/SingleArm-v0", "SpaceCapture/DualArmPlanar-v0"
FINER = 5  # steps of the independent simulation in one of the environment's


def played(env_id, policy, split="test", episodes=3, control_mode=None, **keywords):
    """Recorded episodes of a policy, their metrics and the task."""
    rollout, task = rollout_of(policy, episodes, env_id, split, control_mode, **keywords)
    return rollout, episode_metrics(rollout, task), task


def simulated_again(task, rollout, row):
    """An episode's integrals from MuJoCo alone, in much finer steps under the torques that were recorded."""
    model = task.model.__copy__()
    model.opt.timestep = task.step_size / FINER
    data = mujoco.MjData(model)
    base, n = int(model.jnt_bodyid[0]), model.nu
    free = model.jnt_type[0] == int(mujoco.mjtJoint.mjJNT_FREE)
    first, b = (7, 6) if free else (3, 3)  # the first joint in qpos and in qvel
    model.body_mass[base] *= rollout.goals.mass_scale[row]
    model.body_inertia[base] *= rollout.goals.mass_scale[row]
    mujoco.mj_setConst(model, data)
    data.qpos[:] = rollout.scene[row, 0]
    still = np.array([1.0, 0.0, 0.0, 0.0])
    spins, energies, powers, angles, turned, integrand = [], [], [], [], [], []
    velocity, mass = np.zeros(6), np.zeros((model.nv, model.nv))

    def look(torque):
        mujoco.mj_forward(model, data)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, base, velocity, 0)
        turn = data.ximat[base].reshape(3, 3)
        spins.append(turn @ np.diag(model.body_inertia[base]) @ turn.T @ velocity[:3])
        mujoco.mj_fullM(model, data, mass)
        energies.append(data.qvel[: b + n] @ mass[: b + n, : b + n] @ data.qvel[: b + n])
        powers.append(np.abs(torque * data.qvel[b : b + n]).sum())
        angles.append(np.rad2deg(angle_between(data.xquat[base], still)))
        integrand.append((data.qvel[:b] ** 2).sum())  # of eq. 20, c = 1 m/rad

    look(np.zeros(n))
    for torque in rollout.torque[row, : rollout.length[row]]:
        data.ctrl[:] = torque
        for _ in range(task.substeps * FINER):
            before = data.qpos[first : first + n].copy()
            mujoco.mj_step(model, data)
            turned.append(np.abs(torque * (data.qpos[first : first + n] - before)).sum())
            look(torque)

    def integral(values):
        return model.opt.timestep * (np.sum(values) - 0.5 * (values[0] + values[-1]))

    return {
        "base_angular_impulse": np.linalg.norm(np.diff(spins, axis=0), axis=-1).sum(),
        "kinetic_energy_integral": integral(energies),
        "mechanical_work": np.sum(turned),
        "peak_power": np.max(powers),
        "peak_attitude": np.max(angles),
        "attitude_cost": integral(integrand),
    }


@pytest.mark.parametrize(
    ("env_id", "policy", "control_mode", "split"),
    [
        (PLANAR, "reactionless_rate", "joint_velocity", "test"),
        (PLANAR, "random", "joint_velocity", "ood"),
        (SINGLE, "random", "reactionless", "test"),
        (SINGLE, "random", "joint_torque", "ood"),
    ],
)
def test_integrals_are_those_of_an_independent_simulation_in_finer_steps(env_id, policy, control_mode, split):
    rollout, metrics, task = played(env_id, policy, split, 2, control_mode, horizon=60)
    for row in range(2):
        assert rollout.length[row] == 60
        expected = simulated_again(task, rollout, row)
        del expected["attitude_cost"]
        for name, value in expected.items():
            assert value > 0
            # Chords cut the corner where the satellite turns back within a step.
            bound = 0.03 if name == "base_angular_impulse" else 0.005
            assert metrics[name][row] == pytest.approx(value, rel=bound), name


@pytest.mark.parametrize(
    ("env_id", "policy", "bound"), [(SINGLE, "gjm", 0.01), (PLANAR, "bc", 0.01), (PLANAR, "random", 0.05)]
)
def test_the_sum_of_eq_20_over_control_periods_is_near_its_integral(env_id, policy, bound):
    # Nothing cuts them short in motion.
    rollout, metrics, task = played(env_id, policy, episodes=2, collisions=False)
    for row in range(2):
        integral = simulated_again(task, rollout, row)["attitude_cost"]
        assert integral > 1e-5
        assert metrics["attitude_cost"][row] == pytest.approx(integral, rel=bound)


def full_strokes(env, steps=30):
    """Random actions of full size (T, N, m)."""
    return np.sign(np.random.default_rng(0).normal(size=(steps, *env.action_space.shape)))


@pytest.mark.parametrize("env_id", [SINGLE, PLANAR, "SpaceCapture/DualArmSpatial-v0"])
def test_watching_every_step_of_the_simulation_changes_no_bit(env_id):
    # Rows that end on the way are not stepped any more.
    watched, alone = (
        CaptureVectorEnv(env_id, 6, autoreset_mode="disabled", attitude_limit=2.0) for _ in range(2)
    )
    seen = []
    watched.simulation.watch = lambda: seen.append(watched.simulation.qpos.copy())
    for env in (watched, alone):
        env.reset(seed=0)
    for number, action in enumerate(full_strokes(alone)):
        mine, other = watched.step(action), alone.step(action)
        for one, same in zip(mine[:4], other[:4], strict=True):
            np.testing.assert_array_equal(one, same)
        for name in ("qpos", "qvel", "ctrl", "sensors"):
            np.testing.assert_array_equal(*(getattr(env.simulation, name) for env in (watched, alone)))
        assert len(seen) == (number + 1) * alone.task.substeps
        assert np.array_equal(seen[-1], alone.simulation.qpos) and not np.array_equal(seen[-2], seen[-1])
        ended = mine[4]["outcome"] != "running"
        if ended.all():
            break
    assert ended.any()
