"""Stochastic feedback from a ProMP against computed torque in MuJoCo, under noise and mass errors."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agents.demonstrations.optimal.library import robot_limits
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from agents.policies.single_arm.promp_feedback import POSITION_NOISE, RATE_NOISE
from agents.policies.single_arm.stochastic_feedback import StochasticFeedback
from benchmarks.arguments import check_goals, seed, whole
from benchmarks.machine import machine_class, markdown_table
from promp import ProMP
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array, angle_between, from_matrix, multiply, rotate
from space_envs.simulation import Simulation
from space_envs.system.command_line import Parser, exit_status
from space_envs.tasks.single_arm import SingleArmTask

DURATION, PERIOD, TIMESTEP = 10.0, 0.02, 0.01  # s
TORQUE_NOISE = 0.2  # N m, held over a period
MASSES = 0.1  # relative error of every body's mass and inertia, positive or negative
STILL = np.array([1.0, 0.0, 0.0, 0.0])

Law = Callable[[int, Array, Array], Array]


@dataclass(frozen=True)
class ModelErrors:
    """Differences from the model: noise of measurements and torques, and wrong masses."""

    name: str
    noise: bool
    masses: bool


SETTINGS = (
    ModelErrors("nominal", False, False),
    ModelErrors("noise", True, False),
    ModelErrors("mass error", False, True),
    ModelErrors("both", True, True),
)


def computed_torque(law: StochasticFeedback, frequency: float) -> Law:
    """Accelerations of the mean motion with critically damped feedback, frequency in rad/s."""
    n = law.mean.shape[1]

    def accelerations(step: int, position: Array, rate: Array) -> Array:
        state = law.state[step]
        feedback = frequency**2 * (state[:n] - position) + 2.0 * frequency * (state[n:] - rate)
        return law.mean[step] + feedback

    return accelerations


class LawErrors(NamedTuple):
    """Errors of episodes under a law.

    Attributes:
        joints, joints_at_end: rad, root mean square of the joint error along the motion and at its end.
        position: m and rotation: deg, medians of the end-effector's errors at the end.
        attitude: deg, median of the base's attitude error at the end.
        torque: N m, standard deviation among the episodes.
    """

    joints: float
    joints_at_end: float
    position: float
    rotation: float
    attitude: float
    torque: float


def simulated_errors(
    promp: ProMP, law: Law, reach: Reach, setting: ModelErrors, episodes: int, seed: int
) -> LawErrors:
    """Errors of episodes under a law in MuJoCo, from rest at the start of the reach."""
    rng = np.random.default_rng(seed)
    simulation = _start(reach, setting, episodes, rng)
    functions = ArmFunctions.of(SingleArmTask().mechanics, INTERVALS)
    steps = round(DURATION / PERIOD)
    error, torque = np.empty((2, steps, episodes, simulation.n_joints))
    planned = promp.position(np.linspace(0.0, 1.0, steps + 1)[1:])
    for step in range(steps):
        position, rate = simulation.joint_position.copy(), simulation.joint_velocity.copy()
        if setting.noise:
            position += POSITION_NOISE * rng.standard_normal(position.shape)
            rate += RATE_NOISE * rng.standard_normal(rate.shape)
        (torque[step],) = functions.torque(position, rate, law(step, position, rate))
        simulation.ctrl[:] = torque[step]
        if setting.noise:
            simulation.ctrl[:] += TORQUE_NOISE * rng.standard_normal(position.shape)
        simulation.step(round(PERIOD / TIMESTEP))
        error[step] = simulation.joint_position - planned[step]
    joints, joints_at_end = np.sqrt((error**2).mean()), np.sqrt((error[-1] ** 2).mean())
    variation = np.sqrt(torque.var(axis=1).mean())
    return LawErrors(joints, joints_at_end, *_end_errors(simulation, reach), variation)


def _start(reach: Reach, setting: ModelErrors, episodes: int, rng: np.random.Generator) -> Simulation:
    """Simulation of episodes at rest, with mass errors if the setting has them."""
    model, every = SingleArmTask(timestep=TIMESTEP).model, np.arange(episodes)
    simulation = Simulation(model, episodes)
    simulation.reset(every)
    if setting.masses:
        factor = 1.0 + MASSES * rng.choice([-1.0, 1.0], (episodes, model.nbody))
        simulation.batch.expand("body_mass")[:] = model.body_mass * factor
        simulation.batch.expand("body_inertia")[:] = model.body_inertia * factor[..., None]
        simulation.batch.set_const(every)
    simulation.joint_position[:] = reach.start
    simulation.refresh()
    return simulation


def _end_errors(simulation: Simulation, reach: Reach) -> tuple[float, float, float]:
    """Medians of the end-effector's position, m, and rotation, deg, and of the base's attitude, deg."""
    qpos, _ = simulation.robot_state()
    base, attitude = qpos[:, :3], qpos[:, 3:7]
    local, axes = SingleArmTask().mechanics.end_effector_pose(qpos[:, 7:])
    position = base + rotate(attitude, local) - reach.end.position
    rotation = multiply(attitude, from_matrix(axes))
    goal, still = (np.broadcast_to(each, rotation.shape) for each in (reach.end.quaternion, STILL))
    return (
        float(np.median(np.linalg.norm(position, axis=1))),
        float(np.median(np.rad2deg(angle_between(rotation, goal)))),
        float(np.median(np.rad2deg(angle_between(attitude, still)))),
    )


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.stochastic_feedback", description=__doc__)
    parser.add_argument("--goals", type=whole, default=4, help="validation goals (default %(default)s)")
    parser.add_argument("--episodes", type=whole, default=16, help="of each goal (default %(default)s)")
    parser.add_argument("--seed", type=seed, default=0, help="of noise and masses (default %(default)s)")
    options = parser.parse_args()
    check_goals("SpaceCapture/SingleArm-v0", "validation", options.goals)
    task = SingleArmTask()
    planner = DemonstratedPlanner(
        task.mechanics, robot_limits(SingleArmTask().robot), library_of(task.robot, True)
    )
    figures: dict[tuple[str, str], list[LawErrors]] = {}
    goals = task.goals("validation", np.arange(options.goals))
    used = 0
    for number, (position, quaternion) in enumerate(zip(goals.position, goals.quaternion, strict=True)):
        goal = Grapple.at_rest(position, quaternion)
        reach = Reach(task.mechanics.home, goal, DURATION, keep_attitude=True).checked(task.mechanics)
        space, bounds, _ = planner.planner.setting(reach)
        found = planner.distributions(reach, space, bounds).found
        if not found:
            continue
        used += 1
        promp = found[0].promp
        plain = StochasticFeedback.of(promp, DURATION, PERIOD)
        noisy = StochasticFeedback.of(promp, DURATION, PERIOD, POSITION_NOISE, RATE_NOISE)
        laws = {f"computed torque, {w:g} rad/s": computed_torque(plain, w) for w in (0.5, 1.0, 2.0)}
        laws["stochastic feedback"] = plain.acceleration
        laws["stochastic feedback, noise known"] = noisy.acceleration
        for setting in SETTINGS:
            for name, law in laws.items():
                made = simulated_errors(promp, law, reach, setting, options.episodes, options.seed + number)
                figures.setdefault((setting.name, name), []).append(made)
    rows = []
    for (setting, name), made in figures.items():
        middle = LawErrors(*np.median(made, axis=0).tolist())
        joints = [f"{1e3 * middle.joints:.2f}", f"{1e3 * middle.joints_at_end:.2f}"]
        end_effector = [f"{1e3 * middle.position:.2f}", f"{middle.rotation:.3f}"]
        base = [f"{middle.attitude:.4f}", f"{middle.torque:.3f}"]
        rows.append([setting, name, *joints, *end_effector, *base])
    head = ["setting", "law", "joint error, mrad", "final joint error, mrad", "end-effector, mm"]
    print(markdown_table([*head, "end-effector, deg", "attitude, deg", "torque variation, N m"], rows))
    print(
        f"\nMedians over {used} validation goals, {options.episodes} episodes each, seed {options.seed}; "
        f"{1e3 * PERIOD:g} ms of control, {machine_class()}."
    )


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.stochastic_feedback", main))
