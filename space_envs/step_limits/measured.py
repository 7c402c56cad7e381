"""Time steps of a robot that has none of its own, from a few motions over the whole range of its joints."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from tqdm import tqdm

from space_envs.control import CONTROL_MODES
from space_envs.drives import STOP_MARGIN
from space_envs.errors import ConfigurationError
from space_envs.robots.models.accelerations import reduced_masses
from space_envs.robots.robot import Robot, StepLimits
from space_envs.step_limits.motions import RobotMotion, SimulationSettings, full_range_motion
from space_envs.step_limits.storage import read_steps, write_steps

# Candidates for the largest control period, s. Whether a longer one than that of the tasks is stable depends
# on a few hostile starts, which take longer to find; a description may allow it.
PERIODS = (0.1, 0.05, 0.025)
# Default and largest time step, s; drift is of fourth order: at the default 0.4 of that at the largest.
STEPS = ((0.02, 0.025), (0.01, 0.0125), (0.005, 0.00625), (0.0025, 0.003125), (0.00125, 0.0015625))
DRIFT = 1e-7  # a tenth of the bound, since longer and other motions drift several times as much
PERIOD_MARGIN = 1.5  # motions are measured at so many times the control period
OVERSPEED = 1.6  # times the rate limit, up to which the drives count as stable with that margin
SECONDS, EPISODES = 5.0, 48
ORDER = 4  # of the integrator

UNMEASURED = StepLimits(*STEPS[0], PERIODS[0])


def measured_steps(robot: Robot) -> StepLimits:
    """Time steps with which a robot keeps the momentum bound, found by simulating it; its own are ignored.

    The largest control period is the largest candidate at whose 1.5-fold joints stay within 1.6 times their
    rate limits and half of the stop margin away from the ends of their ranges, in every control mode. The
    largest time step is the largest, from 25 ms by halves, at which momentum drifts by a tenth of the bound
    at most in the same motions: full strokes of 5 s, from home and from starts that the drives can just
    brake. The default is four fifths of it. The result is stored in the user's cache by the robot's digest.

    Raises:
        ConfigurationError: if there are none.
    """
    return _measured(replace(robot, steps=UNMEASURED))


@lru_cache(maxsize=64)
def _measured(robot: Robot) -> StepLimits:
    stored = read_steps(robot.digest)
    if stored is not None:
        return stored
    found = _measure(robot)
    write_steps(robot.digest, found)
    return found


def _measure(robot: Robot) -> StepLimits:
    with tqdm(desc=f"time steps of {robot.name}", unit="motion", leave=False, delay=1.0) as bar:
        for period in PERIODS:
            found = _steps_at(robot, period, bar.update)
            if found is not None:
                return found
    own = reduced_masses(robot).diagonal(axis1=1, axis2=2).min(axis=0)
    joint = int(own.argmin())
    raise ConfigurationError(
        f"robot {robot.name!r} cannot be simulated with any time step from {STEPS[-1][1]:g} to "
        f"{STEPS[0][1]:g} s and control period from {PERIODS[-1]:g} to {PERIODS[0]:g} s: its drives do not "
        "keep the joints within their rate limits and ranges. The least inertia that a joint moves is "
        f"{own[joint]:.1e} kg m^2, of {robot.joints[joint].name!r}; geared drives have more than 0.01 kg m^2 "
        "of their own, which rotor_inertia adds. Lower rate limits or larger torque limits may help too"
    )


def _steps_at(robot: Robot, period: float, done: Callable[[], object]) -> StepLimits | None:
    """Limits with a largest control period; None if the drives are not stable with it.

    Args:
        done: called after every simulated motion.
    """
    measured = None
    for default, largest in STEPS:
        if largest > period / 4 or (measured and _expected(*measured, largest) > 2.0 * DRIFT):
            continue
        drift = _drift(robot, period, largest, done)
        if drift is None:
            return None
        if drift <= DRIFT:
            return StepLimits(default, largest, period)
        measured = largest, drift
    return None


def _expected(step: float, drift: float, other: float) -> float:
    """Drift at another step, by the order of the integrator."""
    return drift * (other / step) ** ORDER


def _drift(robot: Robot, period: float, step: float, done: Callable[[], object]) -> float | None:
    """Largest drift in all control modes, up to the first in which it is too large.

    None as soon as the drives are not stable in one.
    """
    largest = 0.0
    for mode in CONTROL_MODES:
        motion = full_range_motion(
            robot, SimulationSettings(mode, PERIOD_MARGIN * period, step), SECONDS, EPISODES
        )
        done()
        if not stable(motion):
            return None
        largest = max(largest, motion.drift)
        if largest > DRIFT:
            break
    return largest


def stable(motion: RobotMotion) -> bool:
    """Whether the drives kept the joints near their rate limits and away from the ends of their ranges."""
    return motion.peak_rate <= OVERSPEED and motion.stop_distance >= 0.5 * STOP_MARGIN
