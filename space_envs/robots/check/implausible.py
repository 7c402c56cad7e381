"""Rules by which figures of a robot look implausible: one function and one row each.

A finding is no error. It says what a figure is, what is usual, and what may be wrong with the description.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from space_envs.control import DAMPING
from space_envs.drives import BRAKING_RATIO, STOP_MARGIN, braking_deceleration
from space_envs.robots.check.figures.masses import LinkFigures
from space_envs.robots.check.figures.robot_figures import RobotFigures
from space_envs.tasks.goals.poses import ROOM
from space_envs.tasks.robots import USUAL_PERIOD

LENGTHS = (0.2, 25.0)  # m, usual reach
LINEAR_DENSITY = (0.5, 250.0)  # kg/m of a link, from a thin carbon tube to a thick steel bar
SHORT = 0.2  # m; a shorter link is a block of that size
GYRATION = (0.03, 0.6)  # of a link's length: a rod has 0.29, a bar with all mass at its ends 0.5
SATELLITE_GYRATION = (0.1, 0.9)  # of its longest side: a homogeneous cube has 0.41, a hollow one 0.53
CENTRE = 1.0  # m by which a link's centre of mass may lie beyond its length
ARM_SHARE = 1.0  # of the satellite's mass; a heavier arm carries the satellite
ROTOR = 0.01  # kg m^2, of a small motor behind a gear
HOME_ROOM = 0.3 + STOP_MARGIN  # rad around home from which even easy goals are drawn
NARROW = 2.0 * HOME_ROOM  # rad
START_TIMES = (USUAL_PERIOD, 20.0)  # s from rest to the rate limit
FASTEST = 3.2  # rad/s; joints of space robots move at 0.05 to 0.5 rad/s
SLOW_STEP = 0.005  # s; a smaller time step makes simulations slow
BOUND = 1e-6  # of the drift of momentum


@dataclass(frozen=True)
class Finding:
    """Something implausible: the name of the rule, and a sentence with the figure and what is usual."""

    rule: str
    text: str


Rule = Callable[[RobotFigures], Iterator[str]]


def implausible(figures: RobotFigures) -> tuple[Finding, ...]:
    """Everything that looks implausible, in the order of the rules."""
    return tuple(Finding(name, text) for name, rule in RULES.items() for text in rule(figures))


def _link(figures: RobotFigures, link: LinkFigures) -> str:
    arm = f" of arm {link.arm}" if len(figures.robot.arms) > 1 else ""
    return f"link {link.number}{arm} ({link.name})"


def _joint(figures: RobotFigures, index: int) -> str:
    link = figures.masses.links[index]
    arm = f" of arm {link.arm}" if len(figures.robot.arms) > 1 else ""
    return f"joint {link.number}{arm} ({figures.robot.joints[index].name})"


def _units(figures: RobotFigures) -> Iterator[str]:
    for arm, reach in enumerate(figures.masses.reach, start=1):
        if not LENGTHS[0] <= reach <= LENGTHS[1]:
            yield (
                f"the reach of arm {arm} is {reach:.3g} m, where {LENGTHS[0]:g} to {LENGTHS[1]:g} m are "
                "usual; are the lengths in m?"
            )


def _link_mass(figures: RobotFigures) -> Iterator[str]:
    for link in figures.masses.links:
        density = link.mass / max(link.length, SHORT)
        if not LINEAR_DENSITY[0] <= density <= LINEAR_DENSITY[1]:
            yield (
                f"{_link(figures, link)} has {link.mass:.3g} kg on {link.length:.3g} m, where "
                f"{LINEAR_DENSITY[0]:g} to {LINEAR_DENSITY[1]:g} kg/m are usual"
            )


def _link_inertia(figures: RobotFigures) -> Iterator[str]:
    for link in figures.masses.links:
        size = max(link.length, 2.0 * link.centre, SHORT)
        low, high = GYRATION[0] * size, GYRATION[1] * (size + SHORT)
        if not low <= link.gyration <= high:
            yield (
                f"{_link(figures, link)} has a moment of inertia of {max(link.moments):.3g} kg m^2, a radius "
                f"of gyration of {link.gyration:.3g} m, where {low:.2g} to {high:.2g} m are usual for its "
                "length"
            )


def _link_centre(figures: RobotFigures) -> Iterator[str]:
    for link in figures.masses.links:
        if link.centre > link.length + CENTRE:
            yield (
                f"the centre of mass of {_link(figures, link)} is {link.centre:.3g} m from its joint, though "
                f"the link is {link.length:.3g} m long"
            )


def _satellite_mass(figures: RobotFigures) -> Iterator[str]:
    masses = figures.masses
    if masses.arms > ARM_SHARE * masses.satellite:
        yield (
            f"the satellite has {masses.satellite:.4g} kg, less than the {masses.arms:.4g} kg of its arm: "
            "the arm moves the satellite more than itself"
        )


def _satellite_inertia(figures: RobotFigures) -> Iterator[str]:
    side = 2.0 * max(figures.robot.satellite.box)
    gyration = float(np.sqrt(max(figures.masses.satellite_moments) / figures.masses.satellite))
    low, high = (share * side for share in SATELLITE_GYRATION)
    if not low <= gyration <= high:
        yield (
            f"the satellite's moment of inertia of {max(figures.masses.satellite_moments):.4g} kg m^2 is a "
            f"radius of gyration of {gyration:.3g} m, where {low:.2g} to {high:.2g} m are usual for its size "
            f"of {side:.3g} m"
        )


def _weak_drive(figures: RobotFigures) -> Iterator[str]:
    for index, able in enumerate(figures.torques.alone):
        joint = figures.robot.joints[index]
        if able < joint.acceleration_limit:
            yield (
                f"{_joint(figures, index)} can accelerate by {able:.3g} rad/s^2 with its "
                f"{joint.torque_limit:.3g} N m, less than its limit of {joint.acceleration_limit:.3g} rad/s^2"
            )


def _weak_brakes(figures: RobotFigures) -> Iterator[str]:
    braking, usual = braking_deceleration(figures.robot), BRAKING_RATIO * figures.robot.acceleration_limit
    for index in np.flatnonzero(braking < usual).tolist():
        yield (
            f"{_joint(figures, index)} brakes by {braking[index]:.3g} rad/s^2 before the ends of its range, "
            f"not by {BRAKING_RATIO:g} of its acceleration limit, since the torques cannot brake all joints "
            "faster"
        )


def _rotors(figures: RobotFigures) -> Iterator[str]:
    for index, joint in enumerate(figures.robot.joints):
        least = joint.torque_limit / figures.torques.alone[index]
        if least < ROTOR:
            yield (
                f"{_joint(figures, index)} moves {least:.1e} kg m^2 at least, where geared drives have more "
                f"than {ROTOR:g} kg m^2 of their own; rotor_inertia adds it"
            )


def _rates(figures: RobotFigures) -> Iterator[str]:
    for index, joint in enumerate(figures.robot.joints):
        if joint.rate_limit > FASTEST:
            yield (
                f"{_joint(figures, index)} may move at {joint.rate_limit:.3g} rad/s; joints of space robots "
                "move at 0.05 to 0.5 rad/s"
            )
        start = joint.rate_limit / joint.acceleration_limit
        if not START_TIMES[0] <= start <= START_TIMES[1]:
            yield (
                f"{_joint(figures, index)} reaches its rate limit in {start:.3g} s, where {START_TIMES[0]:g} "
                f"to {START_TIMES[1]:g} s are usual"
            )


def _ranges(figures: RobotFigures) -> Iterator[str]:
    for index, joint in enumerate(figures.robot.joints):
        low, high = joint.range
        if high - low < NARROW:
            yield f"{_joint(figures, index)} has a range of {high - low:.3g} rad, where goals need {NARROW:g}"
        elif min(joint.home - low, high - joint.home) < HOME_ROOM:
            yield (
                f"{_joint(figures, index)} is {min(joint.home - low, high - joint.home):.3g} rad from the "
                f"end of its range at home, where goals around home need {HOME_ROOM:g} rad"
            )


def _singular_home(figures: RobotFigures) -> Iterator[str]:
    found = figures.conditioning
    needed = min(found.commanded, figures.robot.n_joints)
    if found.smallest.home < DAMPING or found.rank < needed:
        yield (
            f"home is near a singularity: the smallest singular value of the generalised Jacobian is "
            f"{found.smallest.home:.2g}, and {found.smallest.median:.2g} at half of all configurations"
        )


def _contacts(figures: RobotFigures) -> Iterator[str]:
    for parts, gap in figures.gaps:
        how = f"overlap by {-gap:.2g} m" if gap < 0.0 else f"are {gap:.2g} m apart"
        yield f"at home, {parts} {how}, where goals need a gap of {ROOM:g} m"


def _goals(figures: RobotFigures) -> Iterator[str]:
    if figures.goals:
        yield figures.goals


def _control_period(figures: RobotFigures) -> Iterator[str]:
    largest = figures.measured.largest_control_period
    if largest < USUAL_PERIOD:
        yield (
            f"its drives are stable up to a control period of {largest:g} s only, where tasks have "
            f"{USUAL_PERIOD:g} s; lower rate limits make it longer"
        )


def _time_step(figures: RobotFigures) -> Iterator[str]:
    step = figures.measured.default_timestep
    if step < SLOW_STEP:
        yield (
            f"momentum needs a time step of {step:g} s, and simulations of it are slow; steps of 0.01 to "
            "0.02 s are usual"
        )


def _momentum(figures: RobotFigures) -> Iterator[str]:
    if not figures.drift <= BOUND:
        yield (
            f"momentum drifts by {figures.drift:.1e} with the largest time step and control period of the "
            f"description, more than the bound of {BOUND:g}; measured ones are "
            f"{figures.measured.largest_timestep:g} and {figures.measured.largest_control_period:g} s"
        )


RULES: dict[str, Rule] = {
    "reach": _units,
    "link mass": _link_mass,
    "link inertia": _link_inertia,
    "link centre of mass": _link_centre,
    "satellite mass": _satellite_mass,
    "satellite inertia": _satellite_inertia,
    "weak drive": _weak_drive,
    "weak brakes": _weak_brakes,
    "rotor inertia": _rotors,
    "joint rate": _rates,
    "joint range": _ranges,
    "singular home": _singular_home,
    "contact at home": _contacts,
    "goals": _goals,
    "control period": _control_period,
    "time step": _time_step,
    "momentum": _momentum,
}
