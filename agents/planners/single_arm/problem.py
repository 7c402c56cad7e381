"""Problems and plans of the single arm's optimal planners."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from agents.planners.common.plans import JointPath
from space_envs.checks import finite_array, flag, non_negative
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive, shown
from space_envs.tasks.goals.kinds import GoalKind, asked_attitude, checked_kind


@dataclass(frozen=True, eq=False)
class Reach:
    """Bring the end-effector to the pose and twist of a grapple at a given time, at the least cost by eq. 20.

    The frame is inertial: the base frame at t = 0. Total momentum is zero.

    Attributes:
        start: (n,) joint angles at t = 0, rad. rate: (n,) joint rates at t = 0, rad/s; None for rest.
        goal: pose and twist of the end-effector at T as functions of T.
        duration: T, s. window: earliest and latest T, s, if the planner chooses it; None if it is given.
        keep_attitude: whether the base has its initial attitude at T; it is unconstrained otherwise.
        c: angular to linear conversion of eq. 20, m/rad.
        spheres: (K, 4) centre m and radius m of keep-out spheres, inertial frame; None for none.
        link_radius: m, of the links, which are capsules from joint to joint, in checks against spheres: (n,),
            or one for all.
        kind: what the end-effector has to take of the grapple's pose.
    """

    start: Array
    goal: Grapple
    duration: float = 10.0
    rate: Array | None = None
    keep_attitude: bool = False
    c: float = 1.0
    spheres: Array | None = None
    link_radius: Array | float = 0.0
    window: tuple[float, float] | None = None
    kind: GoalKind = "pose"

    @cached_property
    def end(self) -> PoseTwist:
        """Pose and twist of the end-effector at T, equal for all attitudes that the kind of goal allows."""
        end = self.goal.at(self.duration)
        if self.kind == "pose":
            return end
        return end._replace(quaternion=asked_attitude(self.kind, end.quaternion))

    def checked(self, robot: FloatingRobot) -> Self:
        """Return a copy with float64 arrays and unit quaternions.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, the duration, c or a sphere's
                radius is not positive, the links' radius is negative, the goal is no valid grapple, the
                window is not two increasing positive times, keep_attitude is no flag, or there is no such
                kind of goal.
        """
        n = robot.n_joints
        if not isinstance(self.goal, Grapple):
            raise ConfigurationError(f"goal must be a Grapple, got {shown(self.goal)}")
        spheres = self.spheres
        if spheres is not None:
            spheres = finite_array("spheres", spheres, (None, 4))
            if not (spheres[:, 3] > 0.0).all():
                raise ConfigurationError(f"radii of spheres must be positive, got {spheres[:, 3].tolist()}")
        return replace(
            self,
            start=finite_array("start", self.start, (n,)),
            rate=np.zeros(n) if self.rate is None else finite_array("rate", self.rate, (n,)),
            goal=self.goal.checked(),
            duration=positive("duration", self.duration),
            keep_attitude=flag("keep_attitude", self.keep_attitude),
            c=positive("c", self.c),
            spheres=spheres,
            link_radius=_radii(self.link_radius, n),
            window=None if self.window is None else _increasing(self.window),
            kind=checked_kind(self.kind),
        )


def require_rest(planner: str, reach: Reach) -> None:
    """Refuse problems with a moving goal, or with a time that the planner is to choose.

    Raises:
        ConfigurationError: naming the planner.
    """
    if reach.goal.moves:
        speed, spin = (
            float(np.linalg.norm(each)) for each in (reach.end.linear_velocity, reach.end.angular_velocity)
        )
        raise ConfigurationError(
            f"{planner} plans to goals at rest, this one moves at {speed:.3g} m/s and {spin:.3g} rad/s at T"
        )
    if reach.window is not None:
        raise ConfigurationError(
            f"{planner} plans motions of a given duration, got the window {reach.window}"
        )


def _increasing(window: tuple[float, float]) -> tuple[float, float]:
    """Two positive times, s, the first before the second; ConfigurationError for anything else."""
    earliest, latest = finite_array("window", window, (2,)).tolist()
    if not 0.0 < earliest < latest:
        raise ConfigurationError(f"window must be two increasing positive times, got {window!r}")
    return earliest, latest


def _radii(value: Array | float, n: int) -> Array:
    """Radii (n,) of links; ConfigurationError for another shape or negative numbers."""
    if np.ndim(value) == 0:
        return np.full(n, non_negative("link_radius", value))
    radii = finite_array("link_radius", value, (n,))
    if (radii < 0.0).any():
        raise ConfigurationError(f"link_radius must not be negative, got {radii.tolist()}")
    return radii


@dataclass(frozen=True, eq=False)
class ReachPlan(JointPath):
    """A joint motion that ends with the end-effector at its goal, as fast as the goal.

    Attributes:
        cost: integral of c^2 w.w + v.v over the motion, m^2/s (eq. 20 of shyam2020 times dt).
        violation: errors and violations by name, measured on a dense grid by independent code (`check.py`);
            empty before that.
        notes: how the motion was found.
    """

    cost: float
    violation: Mapping[str, float] = field(default_factory=dict)
    notes: str = ""
