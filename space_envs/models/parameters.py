"""Tables I and II of shyam2020 as frozen parameters, each with its unit and source.

The single-arm robot is a free-floating satellite (link 0) with seven revolute links in standard
(classical) Denavit-Hartenberg convention: frame i is fixed to link i, joint i turns about z of frame
i - 1, and frame 0 is the satellite's centre of mass.
"""

from dataclasses import dataclass
from math import pi

VARIANTS = ("paper", "physical")


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
    """The 7-DoF robot of shyam2020; what the paper leaves open is marked as our choice."""

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
    acceleration_limit: float = 0.25  # rad/s^2, our choice: what 60 N m give the whole arm, roughly
    torque_limit: float = 60.0  # N m, our choice
    rotor_inertia: float = 1.0  # kg m^2 behind the gear, `physical` variant only; our choice
    link_radius: float = 0.08  # m, rods of the `physical` variant and what is drawn; our choice


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
