"""The canonical case and random ones: start of the arms, pose and spin of the target."""

from dataclasses import dataclass
from math import pi

import numpy as np

from agents.planners.dual_arm.problem import Capture
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import PlanningError
from space_envs.robots.models import robot_mechanics
from space_envs.robots.zoo import find_robot

DURATION = 20.0  # s
_ATTEMPTS = 1000
ROBOT = find_robot("shah2013")


@dataclass(frozen=True)
class CaptureCase:
    """Start and target: the satellite rests at the origin, the target rotates about its static centre.

    Attributes:
        index: number of the case; -1 for the canonical one. start: (6,) rad, arm 1 first.
        centre: (x, y) m of the target. angle: rad, of the target at the end. spin: rad/s, of the target.
        half_width: m, of the grapple points from its centre; arm 1 takes the one at -y, arm 2 the one at +y.
        duration: s.
    """

    index: int
    start: tuple[float, ...]
    centre: tuple[float, float]
    angle: float
    spin: float
    half_width: float
    duration: float = DURATION

    @property
    def grapples(self) -> Array:
        """Grapple points (2, 2) m, in the target's frame."""
        return np.array([[0.0, -self.half_width], [0.0, self.half_width]])

    @property
    def capture(self) -> Capture:
        """Boundary conditions: each end-effector at its grapple point, with the velocity of that point."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        arms = self.grapples @ np.array([[c, s], [-s, c]])
        points, velocity = np.zeros((2, 3)), np.zeros((2, 3))
        points[:, :2] = np.array(self.centre) + arms
        velocity[:, :2] = self.spin * np.column_stack([-arms[:, 1], arms[:, 0]])
        return Capture.at_end(np.array(self.start), self.duration, points, velocity)


# shah2013 gives the target's centre, the end velocities (-+0.01, 0) m/s and the arms' rest at the start. The
# start configuration, the grapple points and the duration stood in a figure that is lost; these are our
# choice: grapple points 0.3 m from the centre, which then rotates at -1/30 rad/s.
CANONICAL = CaptureCase(
    index=-1,
    start=(0.0, 1.8, -1.5, 0.9, -0.6, 1.0),
    centre=(2.0, 1.0),
    angle=0.0,
    spin=-0.01 / 0.3,
    half_width=0.3,
)


@dataclass(frozen=True)
class Sampler:
    """Distribution of random cases: uniform, each quantity by itself, around the canonical case.

    A draw is kept if every joint is within its limits and both grapple points lie within a share `reach` of
    what their arms can reach from the system's centre of mass; nearly stretched arms are singular. No other
    draw is rejected: whether a method copes with a case, singular paths included, is what is counted.

    Attributes:
        joint: rad, largest change of each joint angle. displacement: m, of the target's centre, along x
            and y. angle: rad. spin: rad/s, largest, of either sign. half_width: m, least and largest.
    """

    joint: float = 0.5
    displacement: float = 0.4
    angle: float = pi / 6
    spin: float = pi / 45
    half_width: tuple[float, float] = (0.2, 0.4)
    reach: float = 0.7

    def draw(self, seed: int, index: int) -> CaptureCase:
        """Case `index` of a seed, the same whatever else is drawn.

        Raises:
            PlanningError: if no draw is within the limits and in reach.
        """
        rng = np.random.default_rng([seed, index])
        robot = planar_robot()
        for _ in range(_ATTEMPTS):
            case = CaptureCase(
                index=index,
                start=_plain(np.array(CANONICAL.start) + rng.uniform(-self.joint, self.joint, 6)),
                centre=(
                    CANONICAL.centre[0] + float(rng.uniform(-self.displacement, self.displacement)),
                    CANONICAL.centre[1] + float(rng.uniform(-self.displacement, self.displacement)),
                ),
                angle=float(rng.uniform(-self.angle, self.angle)),
                spin=float(rng.uniform(-self.spin, self.spin)),
                half_width=float(rng.uniform(*self.half_width)),
            )
            if _in_range(case) and (reach_used(robot, case) <= self.reach).all():
                return case
        raise PlanningError(f"no case within reach in {_ATTEMPTS} draws of seed {seed}, index {index}")


def planar_robot() -> FloatingRobot:
    """The planar robot of Table I, mounts at (0.5, 0) and (-0.5, 0) m."""
    return robot_mechanics(ROBOT)


def reach_used(robot: FloatingRobot, case: CaptureCase) -> Array:
    """Distance (2,) of the grapple points from the system's centre of mass over what each arm can reach."""
    origin = robot.centre_of_mass(robot.kinematics(np.array(case.start)))
    distance = np.linalg.norm(case.capture.position - origin, axis=1)
    return distance / np.array([robot.reach(arm) for arm in range(2)])


def _in_range(case: CaptureCase) -> bool:
    """Whether every joint starts within its range."""
    low, high = ROBOT.joint_range.T
    return bool(((low <= case.start) & (case.start <= high)).all())


def _plain(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
