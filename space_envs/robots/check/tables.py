"""Figures of a robot as tables of text, the same for the terminal and the page."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from space_envs.robots.check.figures.conditioning import Spread
from space_envs.robots.check.figures.robot_figures import RobotFigures
from space_envs.robots.check.planners import PlannerFigures
from space_envs.robots.check.verification import Verification
from space_envs.robots.robot import StepLimits


@dataclass(frozen=True)
class FigureTable:
    """A table: title, heads, rows of as many cells, and a caption."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


def figure_tables(figures: RobotFigures) -> list[FigureTable]:
    """Tables of all figures of a robot."""
    return [_bodies(figures), _joints(figures), _maps(figures), _modes(figures), _model_errors(figures)]


def planner_table(planners: Sequence[PlannerFigures], split: str) -> FigureTable:
    """Table of the planners, the best first."""
    rows = [
        (
            one.policy,
            one.control_mode,
            f"{one.captured} of {one.goals}",
            f"{100.0 * one.captured / one.goals:.0f} %",
            f"{one.score:.3f}",
            *(
                "-" if np.isnan(angle) else f"{angle:.2g}"
                for angle in (one.peak_attitude, one.final_attitude)
            ),
            one.failure or "-",
        )
        for one in planners
    ]
    heads = (
        "planner",
        "control mode",
        "goals reached",
        "share",
        "kept-attitude score",
        "most frequent failure",
    )
    caption = (
        f"Medium goals of the {split} split, drawn around the robot's home, as evaluate.py counts them. "
        "Attitudes are interquartile means over the captures."
    )
    return FigureTable("Goals that each planner reaches", heads, tuple(rows), caption)


def verification_table(verifications: Sequence[Verification]) -> FigureTable:
    """Table of the tests."""
    outcome = {True: "passed", False: "FAILED", None: "not run"}
    rows = tuple((each.name, outcome[each.passed], each.detail) for each in verifications)
    return FigureTable("Tests of the suite on this robot", ("test", "outcome", "figure"), rows)


def headline(figures: RobotFigures) -> list[tuple[str, str, str]]:
    """Label, value and unit of the figures that come first."""
    masses, conditioning = figures.masses, figures.conditioning
    return [
        ("Mass", f"{masses.total:.4g}", "kg"),
        ("Arms, of the satellite's mass", f"{100 * masses.arms / masses.satellite:.3g}", "%"),
        ("Reach from the centre of mass", " and ".join(f"{reach:.3g}" for reach in masses.reach), "m"),
        ("Centre of mass from the satellite's", f"{np.linalg.norm(masses.centre):.3g}", "m"),
        ("Reaction null space", str(conditioning.null_space), f"of {figures.robot.n_joints} dimensions"),
        ("Momentum drift", f"{figures.drift:.1e}", "of 1e-6"),
        ("Largest time step", f"{1e3 * figures.measured.largest_timestep:g}", "ms, measured"),
        ("Largest control period", f"{figures.measured.largest_control_period:g}", "s, measured"),
        ("Attitude, mode reactionless", f"{np.rad2deg(figures.attitude.reactionless):.2g}", "deg"),
    ]


def _bodies(figures: RobotFigures) -> FigureTable:
    masses = figures.masses
    several = len(figures.robot.arms) > 1
    rows = [("satellite", f"{masses.satellite:.4g}", _vector(masses.satellite_moments), "", "")]
    for link in masses.links:
        number = f"{link.arm}.{link.number}" if several else str(link.number)
        rows.append(
            (
                f"{number} {link.name}",
                f"{link.mass:.4g}",
                _vector(link.moments),
                f"{link.length:.3g}",
                f"{link.centre:.3g}",
            )
        )
    rows.append(("whole robot, at home", f"{masses.total:.4g}", _vector(masses.moments), "", ""))
    heads = ("body", "mass, kg", "principal inertia, kg m^2", "length, m", "centre of mass from joint, m")
    caption = (
        "Inertia about each body's centre of mass. The length of a link is the distance from its joint to "
        f"the next or to the tool. The centre of mass of the whole robot is at {_vector(masses.centre)} m in "
        "the satellite's frame, and its inertia is about it."
    )
    return FigureTable("Masses", heads, tuple(rows), caption)


def _joints(figures: RobotFigures) -> FigureTable:
    rows = []
    for index, joint in enumerate(figures.robot.joints):
        link = figures.masses.links[index]
        number = f"{link.arm}.{link.number}" if len(figures.robot.arms) > 1 else str(link.number)
        rows.append(
            (
                f"{number} {joint.name}",
                f"{joint.home:.4g}",
                f"{joint.range[0]:.4g} to {joint.range[1]:.4g}",
                f"{joint.rate_limit:.3g}",
                f"{joint.acceleration_limit:.3g}",
                f"{joint.torque_limit:.3g}",
                f"{joint.rotor_inertia:.3g}",
                f"{figures.torques.alone[index]:.3g}",
                f"{figures.torques.together[index]:.3g}",
            )
        )
    heads = (
        *("joint", "home, rad", "range, rad", "rate limit, rad/s", "acceleration limit, rad/s^2"),
        *("torque limit, N m", "rotor inertia, kg m^2", "torque gives alone, rad/s^2"),
        "torque gives with all others, rad/s^2",
    )
    caption = (
        "The last two columns are accelerations at the worst of many configurations: of the joint alone, and "
        "of all joints at once in any direction."
    )
    return FigureTable("Joints", heads, tuple(rows), caption)


def _maps(figures: RobotFigures) -> FigureTable:
    found = figures.conditioning
    least, most = found.null_spaces
    spaces = str(least) if least == most else f"{least} to {most}"
    rows = (
        ("generalised Jacobian: smallest singular value", *_spread(found.smallest)),
        ("generalised Jacobian: condition number", *_spread(found.condition)),
        ("rotation of the satellite by unit joint rates", *_spread(found.disturbance)),
        ("dimension of the reaction null space", str(found.null_space), spaces, spaces, spaces),
        ("rank of the generalised Jacobian", f"{found.rank} of {found.commanded}", "", "", ""),
    )
    heads = ("map from joint rates", "at home", "5 %", "median", "95 %")
    caption = (
        "Quantiles over 1,000 configurations, uniform in the joint ranges. Lengths are in units of the "
        "reach. A motion in the reaction null space does not rotate the satellite."
    )
    return FigureTable("Conditioning", heads, rows, caption)


def _modes(figures: RobotFigures) -> FigureTable:
    rows = tuple(
        (one.mode, f"{one.drift:.1e}", f"{one.rate:.2f}", f"{one.distance:.3f}") for one in figures.modes
    )
    heads = ("control mode", "drift of momentum", "peak rate / rate limit", "distance to joint limit, rad")
    caption = (
        "Full-range motions of 20 s from home and from the fastest starts that the drives can brake, with "
        f"the largest steps of the robot: {_steps(figures.robot.steps)}. A measurement finds "
        f"{_steps(figures.measured)}. The drift is relative to the largest momentum of a body, and the suite "
        "promises 1e-6."
    )
    return FigureTable("Momentum and drives", heads, rows, caption)


def _model_errors(figures: RobotFigures) -> FigureTable:
    track, attitude = figures.tracking, figures.attitude
    rows = (
        ("joint rates, of the largest rate", f"{track.rate:.1e}"),
        ("position of the satellite, mm", f"{1e3 * track.position:.2g}"),
        ("attitude of the satellite, deg", f"{np.rad2deg(track.angle):.2g}"),
        ("largest torque, of its limit", f"{track.torque:.2g}"),
        ("attitude under random actions, mode reactionless, deg", f"{np.rad2deg(attitude.reactionless):.2g}"),
        ("the same, mode joint_velocity, deg", f"{np.rad2deg(attitude.joint_velocity):.3g}"),
    )
    caption = (
        "The first rows are errors of minimum-jerk motions of 10 s, in simulation with drives, against the "
        "commanded rates and the momentum-level model that planners use."
    )
    return FigureTable("Tracking and attitude", ("figure", "largest"), rows, caption)


def _angle(degrees: float) -> str:
    return "-" if np.isnan(degrees) else f"{degrees:.2g}"


def _vector(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in np.round(values, 9) + 0.0)


def _spread(spread: Spread) -> tuple[str, str, str, str]:
    return (
        f"{spread.home:.3g}",
        f"{spread.low:.3g}",
        f"{spread.median:.3g}",
        f"{spread.high:.3g}",
    )


def _steps(steps: StepLimits) -> str:
    step, period = 1e3 * steps.largest_timestep, steps.largest_control_period
    return f"a time step of {step:g} ms, a control period of {period:g} s"
