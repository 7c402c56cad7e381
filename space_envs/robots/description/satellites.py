"""The satellite of a description."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from space_envs.checks import numbers
from space_envs.errors import shown
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import box_moments, combined, principal, vector
from space_envs.robots.robot import Inertial, Satellite, Visual

SATELLITE_KEYS = ("mass", "size", "inertia", "mesh", "mesh_scale", "reachable")


def read_satellite(
    table: DescriptionTable, fixed: Sequence[Inertial], visuals: tuple[Visual, ...]
) -> Satellite:
    """The satellite with everything that is fixed to it; its frame is at their common centre of mass.

    Args:
        table: [satellite]. fixed: mass properties of the roots of the arms, in the frame of the satellite
            without them. visuals: what is drawn of them, in the same frame.
    """
    size = table.get("size", hint=": the sides of its box in m")
    sides = table.vector("size", 3) if isinstance(size, list) else (table.positive("size"),) * 3
    if not min(sides) > 0.0:
        raise table.error(f"size must be positive, got {shown(size)}")
    own = _inertial(table, table.positive("mass", hint=", in kg"), sides)
    whole = combined([own, *fixed])
    centre = np.array(whole.centre)
    mesh = _mesh(table)
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


def _mesh(table: DescriptionTable) -> tuple[Visual, ...]:
    name = table.text("mesh", None)
    if name is None:
        return ()
    path = (table.file.parent / name).resolve()
    if not path.is_file():
        raise table.error(f"there is no mesh {str(path)!r}")
    scale = table.vector("mesh_scale", 3, (1.0, 1.0, 1.0))
    return (Visual("mesh", scale, mesh=Path(path)),)


def _shifted(visual: Visual, by: np.ndarray) -> Visual:
    return Visual(
        visual.kind,
        visual.size,
        vector(np.array(visual.position) + by),
        visual.orientation,
        visual.mesh,
        visual.colour,
    )
