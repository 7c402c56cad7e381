"""Inertias and joints of URDF elements, as numbers with their errors."""

import xml.etree.ElementTree as ET

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, shown
from space_envs.robots.description.importing.files.tree import HINGE, LARGEST, SLIDE, FileJoint, Mimic
from space_envs.robots.inertias import principal
from space_envs.robots.robot import Inertial

_KINDS = {"revolute": HINGE, "continuous": HINGE, "prismatic": SLIDE}
_PRODUCTS = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))


def inertial_of(link: ET.Element) -> Inertial | None:
    """Mass properties of a URDF link in its frame; None where it has none.

    Raises:
        ConfigurationError: for missing elements and what are no numbers.
    """
    inertial = link.find("inertial")
    if inertial is None:
        return None
    where = f"<inertial> of link {link.get('name')!r}"
    origin = inertial.find("origin")
    xyz, rpy = (_numbers(where, origin, key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    (mass,) = _numbers(where, _child(where, inertial, "mass"), "value", None, 1)
    element = _child(where, inertial, "inertia")
    moments = {key: _numbers(where, element, key, (0.0,), 1)[0] for row in _PRODUCTS for key in row}
    if missing := [key for key in ("ixx", "iyy", "izz") if element.get(key) is None]:
        raise ConfigurationError(f"{where}: <inertia> has no {', '.join(missing)}")
    axes = _rotation(*rpy)
    inertia = axes @ np.array([[moments[key] for key in row] for row in _PRODUCTS]) @ axes.T
    return principal(mass, np.array(xyz), inertia)


def joint_of(joint: ET.Element) -> FileJoint:
    """A URDF joint that is not fixed.

    Raises:
        ConfigurationError: for an axis of length zero and what are no numbers.
    """
    name, kind = str(joint.get("name")), str(joint.get("type"))
    where = f"joint {name!r}"
    axis = np.array(_numbers(f"{where}: <axis>", joint.find("axis"), "xyz", (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(axis))
    if length < 1e-9 and kind not in ("floating", "planar"):
        raise ConfigurationError(f'{where}: its axis has no length; write its direction: <axis xyz="0 0 1"/>')
    limit = joint.find("limit")
    numbers = {
        key: _numbers(f"{where}: <limit>", limit, key, None, 1)[0]
        for key in ("lower", "upper", "effort", "velocity")
        if limit is not None and limit.get(key) is not None
    }
    bounded = kind in ("revolute", "prismatic") and ("lower" in numbers or "upper" in numbers)
    return FileJoint(
        name=name,
        kind=_KINDS.get(kind, kind),
        axis=axis / (length or 1.0),
        at=np.zeros(3),
        range=(numbers.get("lower", 0.0), numbers.get("upper", 0.0)) if bounded else None,
        rate=numbers.get("velocity"),
        effort=numbers.get("effort"),
        endless=kind == "continuous",
        mimic=_mimic(where, joint.find("mimic")),
    )


def _mimic(where: str, element: ET.Element | None) -> Mimic | None:
    if element is None:
        return None
    (multiplier,) = _numbers(f"{where}: <mimic>", element, "multiplier", (1.0,), 1)
    (offset,) = _numbers(f"{where}: <mimic>", element, "offset", (0.0,), 1)
    return Mimic(element.get("joint", ""), multiplier, offset)


def _child(where: str, element: ET.Element, tag: str) -> ET.Element:
    child = element.find(tag)
    if child is None:
        raise ConfigurationError(f"{where} has no <{tag}>")
    return child


def _numbers(
    where: str, element: ET.Element | None, key: str, default: tuple[float, ...] | None, count: int = 3
) -> tuple[float, ...]:
    """Numbers of an attribute; the default where there is none."""
    text = None if element is None else element.get(key)
    if text is None and default is not None:
        return default
    try:
        values = tuple(float(part) for part in (text or "").split())
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise ConfigurationError(f"{where}: {key} must be {wanted} of at most {LARGEST:g}, got {shown(text)}")
    return values


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
