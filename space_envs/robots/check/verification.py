"""The suite's physics and interface tests on one robot, each with its figure."""

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.utils.env_checker import check_env

from space_envs.control import CONTROL_MODES
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import SpaceEnvsError
from space_envs.registration import find
from space_envs.robots.check.figures.conditioning import random_configurations
from space_envs.robots.check.figures.simulated import EPISODES, SECONDS
from space_envs.robots.check.implausible import BOUND
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Robot
from space_envs.step_limits.measured import stable
from space_envs.step_limits.motions import SimulationSettings, full_range_motion
from space_envs.tasks.robots import usual_period

STATES = 20  # random ones in which two implementations are compared
AGREE = 1e-9  # of the largest entry of a matrix
ROWS, STEPS = 5, 20  # of a vector environment that is compared with single ones


@dataclass(frozen=True)
class Verification:
    """Outcome of a test: its name, whether it passed (None where it cannot run), and a figure in words."""

    name: str
    passed: bool | None
    detail: str


def verify(robot: Robot, env_id: str | None) -> Iterator[Verification]:
    """Outcomes of all tests, one after another.

    Args:
        env_id: of a task that takes the robot; None leaves out the tests of environments.
    """
    tests: dict[str, Callable[[], tuple[bool | None, str]]] = {}
    for mode in CONTROL_MODES:
        tests[f"momentum, {mode}"] = partial(_momentum, robot, mode)
    if env_id is not None:
        for mode in CONTROL_MODES:
            tests[f"rows, {mode}"] = partial(_rows, robot, env_id, mode)
        tests["Gymnasium's check_env"] = partial(_interface, robot, env_id)
    for name, compare in _ORACLES.items():
        tests[f"{name} against MuJoCo"] = partial(_oracle, robot, name, compare)
    for name, test in tests.items():
        try:
            yield Verification(name, *test())
        except SpaceEnvsError as error:
            yield Verification(name, False, str(error))


def _momentum(robot: Robot, mode: str) -> tuple[bool, str]:
    steps = robot.steps
    runs = {
        (usual_period(steps), steps.default_timestep),
        (steps.largest_control_period, steps.largest_timestep),
    }
    motions = [
        full_range_motion(robot, SimulationSettings(mode, *run), SECONDS, EPISODES) for run in sorted(runs)
    ]
    drift = max(motion.drift for motion in motions)
    rate = max(motion.peak_rate for motion in motions)
    passed = drift <= BOUND and all(stable(motion) for motion in motions)
    detail = f"relative drift {drift:.1e}, at most {BOUND:g}; peak rate {rate:.2f} of its limit"
    return passed, detail


def _rows(robot: Robot, env_id: str, mode: str) -> tuple[bool, str]:
    """Whether row i of a vector environment is the environment with one row, bit for bit."""
    keywords = {"robot": robot, "control_mode": mode, "autoreset_mode": "disabled"}
    env = CaptureVectorEnv(find(env_id).name, ROWS, **keywords)
    options = {"split": "validation", "index": np.arange(ROWS)}
    observation, _ = env.reset(seed=0, options=options)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, *env.action_space.shape))
    together = [observation.copy(), *(env.step(action)[0].copy() for action in actions)]
    differing = 0
    for row in range(ROWS):
        single = CaptureVectorEnv(find(env_id).name, 1, **keywords)
        alone, _ = single.reset(seed=0, options={"split": "validation", "index": np.array([row])})
        states = [alone.copy(), *(single.step(action[row : row + 1])[0].copy() for action in actions)]
        differing += sum(
            one[0].tobytes() != all_[row].tobytes() for one, all_ in zip(states, together, strict=True)
        )
    return differing == 0, f"{differing} of {ROWS * (STEPS + 1)} observations differ in a bit"


def _interface(robot: Robot, env_id: str) -> tuple[bool, str]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # of Gymnasium, for what it does not like
            check_env(gym.make(find(env_id).name, robot=robot).unwrapped, skip_render_check=True)
    except Exception as error:  # it reports by any exception
        return False, f"{type(error).__name__}: {error}"
    return True, f"{env_id} without a warning"


def _oracle(robot: Robot, name: str, compare: "Comparison") -> tuple[bool | None, str]:
    if name == "Pinocchio" and find_spec("pinocchio") is None:
        return None, "pinocchio is not installed"
    q = random_configurations(robot, STATES)
    expected = np.array([_mujoco_mass(robot, each) for each in q])
    found = compare(robot, q)
    error = float(np.abs(found - expected[:, : found.shape[1]]).max() / np.abs(expected).max())
    detail = f"largest relative difference {error:.1e}, at most {AGREE:g}"
    return error <= AGREE, detail


def _mujoco_mass(robot: Robot, q: Array) -> Array:
    """MuJoCo's mass matrix (6 + n, 6 + n) of the robot at the origin; in the plane (3 + n, 3 + n)."""
    model = robot_model(robot, SceneOptions(0.01))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    base = 3 if robot.planar else 6
    first = 3 if robot.planar else 7
    data.qpos[:first] = 0.0
    if not robot.planar:
        data.qpos[3] = 1.0
    data.qpos[first : first + robot.n_joints] = q
    mujoco.mj_forward(model, data)
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    size = base + robot.n_joints
    return mass[:size, :size]


Comparison = Callable[[Robot, Array], Array]


def _of_plane(robot: Robot, mass: Array) -> Array:
    """Rows and columns of mass matrices (..., r, 6 + n) for velocities that a robot has."""
    if not robot.planar:
        return mass
    kept = [0, 1, 5, *range(6, 6 + robot.n_joints)]
    rows = [row for row in kept if row < mass.shape[-2]]
    return mass[..., rows, :][..., kept]


def _numpy(robot: Robot, q: Array) -> Array:
    return _of_plane(robot, np.concatenate(robot_mechanics(robot).momentum_matrices(q), axis=-1))


def _casadi(robot: Robot, q: Array) -> Array:
    symbolic = SymbolicRobot(robot_mechanics(robot))
    return _of_plane(robot, np.array([np.array(symbolic.mass_matrix(q=each)["mass"]) for each in q]))


def _pinocchio(robot: Robot, q: Array) -> Array:
    import pinocchio

    tree = robot_mechanics(robot)
    model, joints = pinocchio.Model(), []
    for body in range(tree.n_joints + 1):
        if body == 0:
            joint, parent, place = pinocchio.JointModelFreeFlyer(), 0, pinocchio.SE3.Identity()
        else:
            joint = pinocchio.JointModelRevoluteUnaligned(tree.hinge[body - 1])
            parent = joints[tree.parent[body - 1]]
            place = pinocchio.SE3(tree.mounting[body - 1], tree.offset[body - 1])
        joints.append(model.addJoint(parent, joint, place, f"joint{body}"))
        inertia = pinocchio.Inertia(tree.mass[body], tree.com[body], tree.inertia[body])
        model.appendBodyToJoint(joints[-1], inertia, pinocchio.SE3.Identity())
    data, found = model.createData(), []
    for each in q:
        upper = np.triu(pinocchio.crba(model, data, np.concatenate([[0, 0, 0, 0, 0, 0, 1], each])))
        mass = upper + np.triu(upper, 1).T
        mass[range(6, 6 + tree.n_joints), range(6, 6 + tree.n_joints)] += tree.rotor_inertia
        found.append(mass)
    return _of_plane(robot, np.array(found))


_ORACLES: dict[str, Comparison] = {"numpy": _numpy, "CasADi": _casadi, "Pinocchio": _pinocchio}
