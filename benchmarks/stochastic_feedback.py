"""Stochastic feedback from a ProMP against computed torque in MuJoCo, under noise and masses that are off."""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.demonstrations.optimal.library import model_limits
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from agents.policies.single_arm.stochastic_feedback import StochasticFeedback
from benchmarks.arguments import check_goals, seed, whole
from benchmarks.machine import machine_class, markdown_table
from promp import ProMP
from space_envs.dynamics.rotations import Array, angle_between, from_matrix, multiply, rotate
from space_envs.robots.single_arm import ModelOptions, single_arm_model
from space_envs.simulation import Simulation
from space_envs.system.command_line import Parser, exit_status
from space_envs.tasks.single_arm import SingleArmTask

DURATION, PERIOD, TIMESTEP = 10.0, 0.02, 0.01  # s
POSITION_NOISE, RATE_NOISE = 1e-3, 2e-3  # rad, rad/s, of measured joint angles and rates
TORQUE_NOISE = 0.2  # N m, held over a period
MASSES = 0.1  # share by which every body's mass and inertia are off, up or down
STILL = np.array([1.0, 0.0, 0.0, 0.0])

Law = Callable[[int, Array, Array], Array]


@dataclass(frozen=True)
class Setting:
    """Whether there is noise, and whether masses are off."""

    name: str
    noise: bool
    masses: bool


SETTINGS = (
    Setting("nominal", False, False),
    Setting("noise", True, False),
    Setting("mass error", False, True),
    Setting("both", True, True),
)


def computed_torque(law: StochasticFeedback, frequency: float) -> Law:
    """Accelerations of the mean motion with critically damped feedback, frequency in rad/s."""
    n = law.mean.shape[1]

    def accelerations(step: int, position: Array, rate: Array) -> Array:
        state = law.state[step]
        back = frequency**2 * (state[:n] - position) + 2.0 * frequency * (state[n:] - rate)
        return law.mean[step] + back

    return accelerations


def play(promp: ProMP, law: Law, reach: Reach, setting: Setting, episodes: int, seed: int) -> Array:
    """Figures (6,) of episodes under a law.

    They are the root mean square of the joint error on the way, rad, and at the end, rad; the medians of the
    end-effector's end errors, m and deg, and of the base's end attitude, deg; and the standard deviation of
    torques among the episodes, N m.
    """
    rng = np.random.default_rng(seed)
    model = single_arm_model(ModelOptions(timestep=TIMESTEP))
    simulation, functions = Simulation(model, episodes), ArmFunctions.of(SingleArmTask().robot, INTERVALS)
    every, n = np.arange(episodes), simulation.n_joints
    simulation.reset(every)
    if setting.masses:
        factor = 1.0 + MASSES * rng.choice([-1.0, 1.0], (episodes, model.nbody))
        simulation.batch.expand("body_mass")[:] = model.body_mass * factor
        simulation.batch.expand("body_inertia")[:] = model.body_inertia * factor[..., None]
        simulation.batch.set_const(every)
    simulation.joint_position[:] = reach.start
    simulation.refresh()
    steps = round(DURATION / PERIOD)
    error, torque = np.empty((steps, episodes, n)), np.empty((steps, episodes, n))
    phase = np.linspace(0.0, 1.0, steps + 1)[1:]
    planned = promp.position(phase)
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
    qpos, _ = simulation.robot_state()
    local, turn = SingleArmTask().robot.end_effector_pose(qpos[:, 7:])
    tip = qpos[:, :3] + rotate(qpos[:, 3:7], local)
    turned = multiply(qpos[:, 3:7], from_matrix(turn))
    goal = np.broadcast_to(reach.quaternion, turned.shape)
    return np.array(
        [
            np.sqrt((error**2).mean()),
            np.sqrt((error[-1] ** 2).mean()),
            np.median(np.linalg.norm(tip - reach.position, axis=1)),
            np.median(np.rad2deg(angle_between(turned, goal))),
            np.median(np.rad2deg(angle_between(qpos[:, 3:7], np.broadcast_to(STILL, turned.shape)))),
            np.sqrt(torque.var(axis=1).mean()),
        ]
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
    planner = DemonstratedPlanner(task.robot, model_limits(), shipped_library(True))
    figures: dict[tuple[str, str], list[Array]] = {}
    goals = task.goals("validation", np.arange(options.goals))
    used = 0
    for number, (place, turn) in enumerate(zip(goals.position, goals.quaternion, strict=True)):
        reach = Reach(task.robot.home, place, turn, DURATION, keep_attitude=True).checked(task.robot)
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
                made = play(promp, law, reach, setting, options.episodes, options.seed + number)
                figures.setdefault((setting.name, name), []).append(made)
    rows = []
    for (setting, name), made in figures.items():
        joint, last, tip, turned, attitude, torque = np.median(made, axis=0)
        row = [f"{1e3 * joint:.2f}", f"{1e3 * last:.2f}", f"{1e3 * tip:.2f}", f"{turned:.3f}"]
        rows.append([setting, name, *row, f"{attitude:.4f}", f"{torque:.3f}"])
    head = ["setting", "law", "joint error, mrad", "final joint error, mrad", "end-effector, mm"]
    print(markdown_table([*head, "end-effector, deg", "attitude, deg", "torque variation, N m"], rows))
    print(
        f"\nMedians over {used} validation goals, {options.episodes} episodes each, seed {options.seed}; "
        f"{1e3 * PERIOD:g} ms of control, {machine_class()}."
    )


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.stochastic_feedback", main))
