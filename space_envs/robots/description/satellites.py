"""The satellite of a description."""

from collections.abc import Sequence

import numpy as np

from space_envs.checks import numbers
from space_envs.errors import ConfigurationError, shown
from space_envs.robots.description.importing.files.packages import Packages, resolve
from space_envs.robots.description.importing.geometry import mesh_visuals
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import box_moments, combined, principal, vector
from space_envs.robots.robot import Inertial, Satellite, Visual

SATELLITE_KEYS = ("mass", "size", "inertia", "mesh", "mesh_scale", "reachable")


def read_satellite(
    table: DescriptionTable, fixed: Sequence[Inertial], visuals: tuple[Visual, ...], packages: Packages
) -> Satellite:
    """The satellite with everything that is fixed to it; its frame is at their common centre of mass.

    Args:
        table: [satellite]. fixed: mass properties of the roots of the arms, in the frame of the satellite
            without them. visuals: what is drawn of them, in the same frame. packages: where `package://NAME`
            lies, by name.
    """
    sides = _along_axes(table, "size", hint=": the sides of its box in m")
    own = _inertial(table, table.positive("mass", hint=", in kg"), sides)
    whole = combined([own, *fixed])
    centre = np.array(whole.centre)
    mesh = _mesh(table, packages)
    drawn = tuple(_shifted(visual, -centre) for visual in ((*mesh, *visuals) if mesh else visuals))
    return Satellite(
        inertial=Inertial(whole.mass, whole.moments, axes=whole.axes),
        box=vector(np.array(sides) / 2),
        box_centre=vector(-centre),
        reachable=table.flag("reachable", True),
        visuals=drawn,
        bus=not mesh,
    )


def _inertial(table: DescriptionTable, mass: float, sides: tuple[float, ...]) -> Inertial:
    value = table.get("inertia", None)
    if value is None:
        return Inertial(mass, box_moments(mass, (sides[0], sides[1], sides[2])))
    array = numbers(value)
    if array is not None and array.shape == (3,):
        return Inertial(mass, table.moments("inertia"))
    if array is None or array.shape != (6,) or not np.isfinite(array).all():
        raise table.error(
            "inertia must be [ixx, iyy, izz] or [ixx, iyy, izz, ixy, ixz, iyz] in kg m^2, got " + shown(value)
        )
    xx, yy, zz, xy, xz, yz = array.tolist()
    body = principal(mass, np.zeros(3), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    low, middle, high = sorted(body.moments)
    if not low > 0.0 or high > (low + middle) * (1.0 + 1e-9):
        raise table.error(
            f"inertia belongs to no body: its principal moments {list(body.moments)} kg m^2 must be positive "
            "and each at most the sum of the others"
        )
    return body


def _along_axes(table: DescriptionTable, key: str, hint: str = "") -> tuple[float, float, float]:
    """Three positive numbers, along x, y and z, from three or one."""
    value = table.get(key, hint=hint)
    found = table.vector(key, 3) if isinstance(value, list) else (table.number(key),) * 3
    if not min(found) > 0.0:
        raise table.error(f"{key} must be positive, got {shown(value)}")
    return found


def _mesh(table: DescriptionTable, packages: Packages) -> tuple[Visual, ...]:
    name = table.text("mesh", None)
    if name is None:
        return ()
    scale = _along_axes(table, "mesh_scale") if "mesh_scale" in table else (1.0, 1.0, 1.0)
    try:
        path = resolve(name, table.file, packages).resolve()
        return tuple(mesh_visuals(Visual("mesh", scale), path))
    except ConfigurationError as error:
        raise table.error(str(error)) from None


def _shifted(visual: Visual, by: np.ndarray) -> Visual:
    return Visual(
        visual.kind,
        visual.size,
        vector(np.array(visual.position) + by),
        visual.orientation,
        visual.mesh,
        visual.colour,
    )
