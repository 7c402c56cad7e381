"""Momentum drift, trajectory error and speed of the simulation against its time step.

Random actions are held for 0.1, 0.5, 2 or 3 s, by episode in turn; the second half of each episode uses full
strokes only, which bring the arm to full speed and to its stops.
The error is that of the base after the same torques, against a run with a quarter of the smallest step.
"""

import argparse
from time import perf_counter

import numpy as np
from tqdm import tqdm

from benchmarks.machine import machine_class, markdown_table
from space_envs.control import CONTROL_MODES
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.models.parameters import VARIANTS
from space_envs.models.single_arm import ModelOptions, single_arm_model
from space_envs.simulation import Simulation

STEPS = (0.005, 0.01, 0.02, 0.05)
REFERENCE = 0.00125
HOLDS = (1, 5, 20, 30)  # control steps that an action is held, by episode in turn


def drift(
    variant: str, mode: str, timestep: float, episodes: int, seed: int
) -> tuple[float, float, np.ndarray]:
    """Largest drift (N s or N m s), largest ratio to what a body carried, and torques (E, T, n)."""
    env = CaptureVectorEnv(
        num_envs=episodes,
        autoreset_mode="disabled",
        control_mode=mode,
        variant=variant,
        timestep=timestep,
        attitude_limit=179.9,
        hold_time=1e3,
    )
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    hold = np.resize(HOLDS, episodes)
    simulation, states, torques = env.simulation, [], []
    action = np.zeros(env.action_space.shape)
    for step in range(env.task.horizon):
        states.append((simulation.qpos.copy(), simulation.qvel.copy()))
        draw = rng.uniform(-1.0, 1.0, action.shape)
        action = np.where((step % hold == 0)[:, None], draw, action)
        env.step(np.sign(action) if 2 * step >= env.task.horizon else action)
        torques.append(simulation.ctrl.copy())
    states.append((simulation.qpos.copy(), simulation.qvel.copy()))
    qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
    absolute, ratio = momentum_drift(body_motion(env.task.robot, qpos, qvel))
    return float(absolute.max()), float(ratio.max()), np.stack(torques, axis=1)


def replay(variant: str, timestep: float, torques: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Base position and quaternion after 10 s of held torques, and control steps a second on all threads."""
    simulation = Simulation(single_arm_model(ModelOptions(variant, timestep)), len(torques), threads=None)
    simulation.reset(np.arange(len(torques)))
    before = perf_counter()
    for step in range(100):
        simulation.ctrl[:] = torques[:, step]
        simulation.step(round(0.1 / timestep))
    rate = 100 * len(torques) / (perf_counter() - before)
    return simulation.qpos[:, :3].copy(), simulation.qpos[:, 3:7].copy(), rate


def main(arguments: list[str] | None = None) -> None:
    """Print the tables of docs/momentum.md."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.momentum", description=__doc__)
    parser.add_argument("--episodes", type=int, default=64, help="episodes for each cell (default 64)")
    parser.add_argument("--seed", type=int, default=0, help="of actions and goals (default 0)")
    options = parser.parse_args(arguments)
    rows = []
    cells = [(v, t) for v in VARIANTS for t in STEPS]
    references: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    for variant, timestep in tqdm(cells, unit="cell"):
        results = {m: drift(variant, m, timestep, options.episodes, options.seed) for m in CONTROL_MODES}
        if variant not in references:
            torques = results["joint_velocity"][2]
            position, quaternion, _ = replay(variant, REFERENCE, torques)
            references[variant] = (torques, position, quaternion)
        torques, position, quaternion = references[variant]
        got_position, got_quaternion, rate = replay(variant, timestep, torques)
        error = 1e3 * np.linalg.norm(got_position - position, axis=1).max()
        angle = np.rad2deg(angle_between(got_quaternion, quaternion)).max()
        rows.append(
            [variant, f"{1e3 * timestep:g}"]
            + [f"{results[m][1]:.1e}" for m in CONTROL_MODES]
            + [f"{max(r[0] for r in results.values()):.1e}", f"{error:.1e}", f"{angle:.1e}", f"{rate:,.0f}"]
        )
    print(f"\n{options.episodes} episodes of 20 s a control mode, seed {options.seed}; {machine_class()}\n")
    header = [
        "variant",
        "step, ms",
        *CONTROL_MODES,
        "largest drift, N s or N m s",
        "base error, mm",
        "base error, deg",
    ]
    print(markdown_table([*header, "control steps/s"], rows))


if __name__ == "__main__":
    main()
