"""The zoo in its sources, typed from these and not from the descriptions; SI units, angles in deg."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def screw(axis: int, angle: float, length: float) -> Matrix:
    """Homogeneous transformation: rotation about a coordinate axis by rad, and translation along it."""
    c, s, (i, j) = np.cos(angle), np.sin(angle), ((1, 2), (2, 0), (0, 1))[axis]
    matrix = np.eye(4)
    matrix[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    matrix[axis, 3] = length
    return matrix


def standard(rows: Sequence[tuple[float, float, float, float, float]], q: Matrix) -> Matrix:
    """Last frame of standard Denavit-Hartenberg rows: a, d, alpha, sign and offset of the joint angle."""
    pose = np.eye(4)
    for (a, d, alpha, sign, offset), angle in zip(rows, q, strict=True):
        pose = pose @ screw(2, sign * angle + np.deg2rad(offset), d) @ screw(0, np.deg2rad(alpha), a)
    return pose


def modified(rows: Sequence[tuple[float, float, float]], q: Matrix) -> Matrix:
    """Last frame of modified Denavit-Hartenberg rows: a and alpha of the link before, d; q in rad."""
    pose = np.eye(4)
    for (a, d, alpha), angle in zip(rows, q, strict=True):
        pose = pose @ screw(0, np.deg2rad(alpha), a) @ screw(2, angle, d)
    return pose


@dataclass(frozen=True)
class Published:
    """A robot in its sources.

    Attributes:
        satellite: mass with what is fixed to it, kg. mount: of the arm's root, m.
        masses: of the links, kg. traces: of their inertia matrices about their centres of mass, kg m^2; the
            last link has none where a hand is added to it.
        ranges: of the joints. torques: N m; empty where nobody publishes them.
        tool: of the tool in the arm's root, from joint angles in rad.
    """

    satellite: float
    mount: tuple[float, float, float]
    masses: tuple[float, ...]
    traces: tuple[float, ...]
    ranges: tuple[tuple[float, float], ...]
    tool: Callable[[Matrix], Matrix]
    torques: tuple[float, ...] = field(default=())


def _panda(q: Matrix) -> Matrix:
    """Franka Control Interface documentation, Denavit-Hartenberg parameters; flange 107 mm, hand 103.4 mm."""
    rows = (
        *((0, 0.333, 0), (0, 0, -90), (0, 0.316, 90), (0.0825, 0, 90)),
        *((-0.0825, 0.384, -90), (0, 0, 90), (0.088, 0, 90)),
    )
    return modified(rows, q) @ screw(2, -np.pi / 4, 0.107 + 0.1034)


def _xarm7(q: Matrix) -> Matrix:
    """UFACTORY, Kinematic and Dynamic Parameters of xArm 7, modified Denavit-Hartenberg parameters."""
    rows = (
        *((0, 0.267, 0), (0, 0, -90), (0, 0.293, 90), (0.0525, 0, 90)),
        *((0.0775, 0.3425, 90), (0, 0, 90), (0.076, 0.097, -90)),
    )
    return modified(rows, q)


def _universal(
    d1: float, a2: float, a3: float, d4: float, d5: float, d6: float
) -> Callable[[Matrix], Matrix]:
    """Universal Robots, DH parameters for calculations of kinematics and dynamics; its base has -x as x."""
    rows = (
        *((0, d1, 90, 1, 0), (a2, 0, 0, 1, 0), (a3, 0, 0, 1, 0)),
        *((0, d4, 90, 1, 0), (0, d5, -90, 1, 0), (0, d6, 0, 1, 0)),
    )
    return lambda q: screw(2, np.pi, 0.0) @ standard(rows, q)


def _kinova(q: Matrix) -> Matrix:
    """Kinova, j2s6s200: D1 to D6 and e2 of its Denavit-Hartenberg parameters; not the tool's own axes."""
    d1, d2, d3, d4, d5, d6, e2 = 0.2755, 0.41, 0.2073, 0.10375, 0.10375, 0.16, 0.0098
    rows = (
        *((0, d1, 90, -1, 0), (d2, 0, 180, 1, -90), (0, -e2, 90, 1, 90)),
        *((0, -(d3 + d4), 90, 1, 0), (0, 0, 90, 1, 0), (0, -(d5 + d6), 180, 1, 90)),
    )
    return screw(2, np.pi / 2, 0.0) @ standard(rows, q)


def _ets_vii(q: Matrix) -> Matrix:
    """Yoshida 2003 in Dimitrov's frames: each is rotated about x, y and then, with the joint, z."""
    steps = (
        ((0, 0, 0), (0, 0, 0)),
        ((0, 0.275, 0.35), (-90, 0, -90)),
        ((0.87, 0, 0), (0, 0, 90)),
        ((0.63, 0, 0.275), (0, 0, -90)),
        ((0, 0, -0.267), (90, 90, 0)),
        ((0, 0, 0.277), (180, 90, 0)),
    )
    pose = np.eye(4)
    for (position, (x, y, z)), angle in zip(steps, q, strict=True):
        offset = np.eye(4)
        offset[:3, 3] = position
        about_x, about_y = screw(0, np.deg2rad(x), 0.0), screw(1, np.deg2rad(y), 0.0)
        pose = pose @ offset @ about_x @ about_y @ screw(2, np.deg2rad(z) + angle, 0.0)
    return pose @ screw(2, 0.0, 0.532)


PUBLISHED = {
    "ets_vii": Published(
        satellite=2552.0,
        mount=(-0.785, -0.295, 1.0),
        masses=(35.0, 22.7, 21.4, 16.8, 26.2, 18.1),
        traces=(1.22 + 0.513 + 1.33, 0.10 + 3.38 + 3.36, 0.43 + 2.27 + 1.91, 0.8587, 1.298, 0.55),
        ranges=((-171.887, 171.887),) * 6,
        tool=_ets_vii,
    ),
    "panda": Published(
        satellite=150.0 + 0.629769,
        mount=(0.3, 0.0, 0.4),
        # Gaz et al. 2019, Table; hand 0.73 kg and fingers 15 g each of the vendor.
        masses=(4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522 + 0.73 + 0.03),
        traces=(
            *(0.70337 + 0.70661 + 0.009117, 0.007962 + 0.02811 + 0.025995, 0.037242 + 0.036155 + 0.01083),
            *(0.025853 + 0.019552 + 0.028323, 0.035549 + 0.029474 + 0.008627, 0.001964 + 0.004354 + 0.005433),
        ),
        ranges=((-166, 166), (-101, 101), (-166, 166), (-176, -4), (-166, 166), (-1, 215), (-166, 166)),
        torques=(87, 87, 87, 87, 12, 12, 12),
        tool=_panda,
    ),
    "xarm7": Published(
        satellite=120.0 + 0.88556,
        mount=(0.26, 0.0, 0.35),
        masses=(2.382, 1.869, 1.6383, 1.7269, 1.3203, 1.325, 0.17),
        traces=(
            *(0.0056905 + 0.0049566 + 0.003316654, 0.0095989 + 0.00382472 + 0.007565669),
            *(0.00310955 + 0.00264483 + 0.0026624, 0.005889 + 0.00359703 + 0.00543244),
            *(0.00534665 + 0.0049779 + 0.0013624, 0.0014745 + 0.0019037 + 0.0023652),
            9.3e-05 + 5.87e-05 + 0.000132,
        ),
        ranges=((-360, 360), (-118, 120), (-360, 360), (-11, 225), (-360, 360), (-97, 180), (-360, 360)),
        torques=(50, 50, 30, 30, 30, 20, 20),
        tool=_xarm7,
    ),
    "ur10": Published(
        satellite=300.0 + 4.0,
        mount=(0.375, 0.0, 0.5),
        masses=(7.778, 12.93, 3.87, 1.96, 1.96, 0.202),
        traces=(0.08482425, 0.87987323, 0.23302376, 0.01572900, 0.01572900, 0.00162105),
        ranges=((-360, 360), (-360, 360), (-180, 180), (-360, 360), (-360, 360), (-360, 360)),
        torques=(330, 330, 150, 54, 54, 54),
        tool=_universal(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    ),
    "kinova": Published(
        satellite=100.0 + 0.46784,
        mount=(0.225, 0.0, 0.3),
        masses=(0.7477, 0.99, 0.6763, 0.463, 0.463, 0.99 + 4 * 0.01),
        traces=(0.00363879, 0.02179642, 0.00314478, 0.00095686, 0.00095686),
        ranges=((-360, 360), (47, 313), (19, 341), (-360, 360), (30, 330), (-360, 360)),
        tool=_kinova,
    ),
}
