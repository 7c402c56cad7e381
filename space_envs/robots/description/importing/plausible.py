"""Errors of mass properties that no body can have, and of units that are none of this suite."""

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.robots.robot import Inertial

_HEAVIEST = 1e5  # kg, of one body of an arm; the arm of the space station has 1.8 t
_WIDEST = 30.0  # m, radius of gyration and offset between joints; that arm is 17 m long
_ROUNDING = 1e-6  # of the largest moment: published numbers are rounded


def inertia_problem(name: str, inertial: Inertial | None) -> str | None:
    """Why a body cannot have these mass properties; None if it can, or has none.

    Raises:
        ConfigurationError: for numbers that are wrong whatever the body is fixed to: a negative mass, other
            units.
    """
    if inertial is None:
        return None
    _check_units(name, inertial)
    moments = np.sort(inertial.moments)
    shown = _listed(inertial)
    if moments[0] < -_ROUNDING * moments[2] or moments[2] < 0.0:
        return (
            f"the inertia of link {name!r} is not positive definite: its principal moments are {shown} kg "
            "m^2. Check signs, and whether ixy, ixz, iyz are larger than the moments allow"
        )
    if moments[0] + moments[1] < (1.0 - _ROUNDING) * moments[2]:
        return (
            f"the inertia of link {name!r} breaks the triangle inequality: of its principal moments {shown} "
            "kg m^2, the largest is more than the sum of the others, which no body has. Write the inertia "
            "about the centre of mass, from the geometry if it is not known"
        )
    return None


def _check_units(name: str, inertial: Inertial) -> None:
    mass = inertial.mass
    if mass < 0.0:
        raise ConfigurationError(f"the mass of link {name!r} is {mass:g} kg; a mass is not negative")
    if mass > _HEAVIEST:
        raise ConfigurationError(
            f"the mass of link {name!r} is {mass:g} kg, more than {_HEAVIEST:g}: is it in grams? Write it "
            "in kg"
        )
    if mass > 0.0 and (radius := np.sqrt(max(*inertial.moments, 0.0) / mass)) > _WIDEST:
        raise ConfigurationError(
            f"the inertia of link {name!r}, {_listed(inertial)} kg m^2, belongs to {mass:g} kg at "
            f"{radius:.3g} m from the axis: is it in g mm^2 or kg mm^2? Write it in kg m^2"
        )


def _listed(inertial: Inertial) -> str:
    return ", ".join(f"{value:.6g}" for value in inertial.moments)


def checked_link(name: str, joint: str, inertial: Inertial | None, files: str) -> Inertial:
    """Mass properties of a link that moves, if it has mass and inertia.

    Args:
        name: of the link. joint: that moves it. inertial: with what is fixed to it. files: how a mass is
            written in its format.

    Raises:
        ConfigurationError: if it has not.
    """
    if inertial is None:
        raise ConfigurationError(
            f"link {name!r}, which joint {joint!r} moves, has no mass, nor has anything that is fixed to it: "
            f"write its {files}"
        )
    if min(inertial.moments) <= 0.0:
        raise ConfigurationError(
            f"link {name!r}, which joint {joint!r} moves, has a mass of {inertial.mass:g} kg but principal "
            f"moments of inertia of {_listed(inertial)} kg m^2: all three must be positive; write its {files}"
        )
    return inertial


def check_offset(name: str, distance: float) -> None:
    """Reject a joint that is farther from the one before than any arm is long."""
    if distance > _WIDEST:
        raise ConfigurationError(
            f"joint {name!r} is {distance:g} m from the joint before it: is the file in millimetres? Write "
            "lengths in m"
        )
