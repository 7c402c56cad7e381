"""All figures of a robot that need no planner."""

from dataclasses import dataclass

from space_envs.robots.check.figures.conditioning import ConditioningFigures, conditioning
from space_envs.robots.check.figures.contacts import HomeGap, home_gaps
from space_envs.robots.check.figures.goals import goal_problem
from space_envs.robots.check.figures.masses import MassFigures, TorqueFigures, mass_figures, torque_figures
from space_envs.robots.check.figures.simulated import (
    AttitudeFigures,
    ModeFigures,
    TrackingFigures,
    attitude,
    mode_figures,
    tracking,
)
from space_envs.robots.robot import Robot, StepLimits
from space_envs.step_limits.measured import measured_steps


@dataclass(frozen=True)
class RobotFigures:
    """Figures of a robot, measured.

    Attributes:
        robot: that they are of. masses, conditioning, torques, modes, tracking, attitude: figures.
        gaps: pairs of parts that are close at home. goals: reason why goals cannot be drawn, or empty.
        measured: time steps that a measurement finds; those of the robot may be smaller or larger.
    """

    robot: Robot
    masses: MassFigures
    conditioning: ConditioningFigures
    torques: TorqueFigures
    gaps: tuple[HomeGap, ...]
    goals: str
    measured: StepLimits
    modes: tuple[ModeFigures, ...]
    tracking: TrackingFigures
    attitude: AttitudeFigures

    @property
    def drift(self) -> float:
        """Largest relative drift of momentum in all control modes."""
        return max(mode.drift for mode in self.modes)

    @property
    def rate(self) -> float:
        """Largest joint rate in all control modes, relative to its limit."""
        return max(mode.rate for mode in self.modes)


def robot_figures(robot: Robot) -> RobotFigures:
    """Figures of a robot, in some ten seconds.

    Raises:
        ConfigurationError: if no time step keeps the momentum bound.
    """
    return RobotFigures(
        robot,
        mass_figures(robot),
        conditioning(robot),
        torque_figures(robot),
        home_gaps(robot),
        goal_problem(robot),
        measured_steps(robot),
        mode_figures(robot),
        tracking(robot),
        attitude(robot),
    )
