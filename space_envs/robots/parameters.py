"""Tables I and II of shyam2020 as frozen parameters, each with its unit and source.

The single-arm robot is a free-floating satellite (link 0) with seven revolute links in standard
(classical) Denavit-Hartenberg convention: frame i is fixed to link i, joint i rotates about z of frame
i - 1, and frame 0 is the satellite's centre of mass.
"""

from dataclasses import dataclass
from math import pi

from space_envs.robots.robot import StepLimits

VARIANTS = ("paper", "physical")


# Verified for full-range motions in every control mode by python -m benchmarks.limits: momentum
# drifts by at most a quarter of the bound of 1e-6, no joint comes near the end of its range, and rates stay
# within 1.2 times their limit. At 0.3 s the servo of `physical` reaches 1.6 times, at 0.5 s 27 times. A
# search for the worst fast start exceeded the bound in `physical` at 0.15 s, in the spatial robot at 0.2 s.
STEP_LIMITS = {
    "paper": StepLimits(0.02, 0.025, 0.2),
    "physical": StepLimits(0.01, 0.0125, 0.1),
    "planar": StepLimits(0.02, 0.025, 0.2),
    "spatial": StepLimits(0.01, 0.0125, 0.1),
}
LEAST_TIMESTEP = 1e-4  # s; finer steps change nothing, and a control period of them takes minutes


@dataclass(frozen=True)
class DHLink:
    """One link of Table I and Table II.

    The pose of frame i in frame i - 1 is Rz(theta) Tz(d) Tx(a) Rx(alpha), theta being the joint angle.
    """

    alpha: float  # rad, Table I
    a: float  # m, Table I
    d: float  # m, Table I
    mass: float  # kg, Table II
    inertia: tuple[float, float, float]  # kg m^2 about the centre of mass, axes of DH frame i, Table II

    @property
    def length(self) -> float:
        """Distance between the origins of frames i - 1 and i, m."""
        return (self.a**2 + self.d**2) ** 0.5


@dataclass(frozen=True)
class SingleArmParameters:
    """The 7-DoF robot of shyam2020; values not given in the paper are marked as our choice."""

    satellite_mass: float = 200.0  # kg, Table II, L 0
    satellite_inertia: tuple[float, float, float] = (1400.0, 1400.0, 2040.0)  # kg m^2, Table II, L 0
    satellite_side: float = 1.0  # m; d1 = 0.5 m then puts the shoulder on a face; our reading
    links: tuple[DHLink, ...] = (
        DHLink(-pi / 2, 0.0, 0.5, 20.0, (0.10, 0.10, 0.10)),
        DHLink(pi / 2, 0.0, 0.0, 30.0, (0.25, 25.0, 25.0)),
        DHLink(pi / 2, 0.9, 0.0, 30.0, (0.25, 25.0, 25.0)),
        DHLink(-pi / 2, 0.9, 0.0, 20.0, (0.25, 25.0, 25.0)),
        DHLink(pi / 2, 0.8, 0.0, 20.0, (0.25, 25.0, 25.0)),
        DHLink(-pi / 2, 0.8, 0.0, 20.0, (0.25, 25.0, 25.0)),
        DHLink(pi / 2, 0.0, 0.8, 20.0, (0.25, 25.0, 25.0)),
    )
    home: tuple[float, ...] = (0.0, 5 * pi / 4, 0.0, 0.0, pi / 2, -pi / 2, 0.0)  # rad, sec. VI
    joint_reach: float = 3.0  # rad to either side of home; our choice, the paper gives no limits
    rate_limit: float = 0.3  # rad/s, our choice: a slow, strong arm as flown on stations
    acceleration_limit: float = 0.25  # rad/s^2, our choice: about what 60 N m give the whole arm
    torque_limit: float = 60.0  # N m, our choice
    rotor_inertia: float = 1.0  # kg m^2 behind the gear, `physical` variant only; our choice
    link_radius: float = 0.08  # m, rods of the `physical` variant and visual geometry; our choice


SINGLE_ARM = SingleArmParameters()


def rod_inertia(mass: float, radius: float, along: tuple[float, float, float]) -> tuple[float, float, float]:
    """Principal inertia of a solid cylinder whose axis is one of the frame's axes, kg m^2.

    Args:
        mass: kg.
        radius: m.
        along: the cylinder's axis times its length, m, with at most one component that is not zero.
            A link of length zero (the second of Table I) is a cylinder as long as its diameter, about z.
    """
    length = max(map(abs, along)) or 2 * radius
    axis = max(range(3), key=lambda i: abs(along[i])) if any(along) else 2
    transverse = mass * (3 * radius**2 + length**2) / 12
    moments = [transverse] * 3
    moments[axis] = mass * radius**2 / 2
    return (moments[0], moments[1], moments[2])


def cube_inertia(mass: float, side: float) -> tuple[float, float, float]:
    """Principal inertia of a homogeneous cube, kg m^2."""
    moment = mass * side**2 / 6
    return (moment, moment, moment)


@dataclass(frozen=True)
class PlanarLink:
    """One link of an arm of shah2013: a body that rotates in the plane, with its mass in the middle."""

    length: float  # m, Table I
    mass: float  # kg, Table I
    inertia: float  # kg m^2 about the centre of mass, out of the plane, Table I


@dataclass(frozen=True)
class TargetParameters:
    """Target of two arms; all values are our choice, the paper has none."""

    mass: float  # kg
    inertia: tuple[float, float, float]  # kg m^2, principal, at the nominal size; scales with its square
    half_width: float  # m, nominal distance of the grapple points from the centre
    body: tuple[float, float, float]  # m, half sides of the box between the grapple points, nominal
    gripper: float = 0.15  # m, outer part of an arm that may touch the target


@dataclass(frozen=True)
class DualArmPlanarParameters:
    """The planar robot of shah2013: Table I; values not given there are marked as our choice."""

    satellite_mass: float = 500.0  # kg, Table I
    satellite_inertia: float = 83.61  # kg m^2, Table I
    satellite_side: float = 1.0  # m, Table I
    arm: tuple[PlanarLink, ...] = (PlanarLink(1.0, 10.0, 1.05),) * 3  # of both arms, Table I
    mounts: tuple[tuple[float, float], ...] = ((0.5, 0.0), (-0.5, 0.0))  # m, the lost Fig. 1; our reading
    home: tuple[float, ...] = (-0.9, 1.4, 0.6, 1.4, -0.5, -0.6)  # rad, our choice; open, not symmetric
    first_reach: float = 3.1  # rad, largest angle of the joint at the mount; our choice
    joint_reach: float = 2.7  # rad, largest angle of the others; our choice
    rate_limit: float = 0.3  # rad/s, our choice
    acceleration_limit: float = 0.25  # rad/s^2, our choice
    torque_limit: float = 60.0  # N m, our choice
    link_radius: float = 0.05  # m, for clearances and visual geometry; our choice
    target: TargetParameters = TargetParameters(100.0, (10.0, 10.0, 10.0), 0.3, (0.16, 0.18, 0.16))


DUAL_ARM_PLANAR = DualArmPlanarParameters()


@dataclass(frozen=True)
class DualArmSpatialParameters:
    """Two 7-DoF arms on a bus, the extension that shah2013 announces; parameters are our choice.

    Each arm has the Denavit-Hartenberg lengths of shyam2020's Table I at half scale, with solid rods as
    links. Arm 1 stands on the face at +x, arm 2 on the one at -x, near its front; both reach towards +y.
    """

    satellite_mass: float = 500.0  # kg, as in shah2013
    satellite_side: float = 1.0  # m; a homogeneous cube
    forward: float = 0.35  # m, of the mounts from the middle of their faces towards +y
    alpha: tuple[float, ...] = tuple(link.alpha for link in SINGLE_ARM.links)  # rad, shyam2020, Table I
    a: tuple[float, ...] = tuple(link.a / 2 for link in SINGLE_ARM.links)  # m, half of Table I
    d: tuple[float, ...] = tuple(link.d / 2 for link in SINGLE_ARM.links)  # m, half of Table I
    mass: tuple[float, ...] = tuple(link.mass / 2 for link in SINGLE_ARM.links)  # kg, half of Table II
    # rad; elbows out, hands before the bus, not symmetric
    home: tuple[float, ...] = (
        *(-1.17, -1.86, -1.23, 2.10, 0.21, -0.22, 0.17),
        *(-1.85, -1.80, -1.49, 1.12, 0.10, 0.81, 0.41),
    )
    joint_reach: float = 2.9  # rad to either side of zero
    rate_limit: float = 0.3  # rad/s
    acceleration_limit: float = 0.25  # rad/s^2
    torque_limit: float = 60.0  # N m
    rotor_inertia: float = 0.5  # kg m^2 behind the gear
    link_radius: float = 0.05  # m, of the rods
    target: TargetParameters = TargetParameters(120.0, (12.0, 16.0, 20.0), 0.3, (0.18, 0.24, 0.22))


DUAL_ARM_SPATIAL = DualArmSpatialParameters()
