"""Draw the pictures of docs/primer.md: `python -m docs.primer` writes docs/images/primer_*.svg."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.policies.single_arm.promp import prior_of
from docs.pictures import IMAGES
from docs.primer_motions import (
    LINE,
    NODES,
    ROBOT,
    PlanarMotion,
    loops,
    planar_robot,
    reactionless_swing,
    straight_line,
    swing,
)
from promp import ProMP, ViaPoint
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, VERMILION
from space_envs.evaluation.report.drawing.panel import INK, LONE, draw_panel
from space_envs.robots.zoo import find_robot
from space_envs.system.command_line import Parser, exit_status, output_path
from space_envs.system.files import atomic_write_text

JOINT = 3  # of the single arm, counted from 0, in the picture of the ProMP
GOAL = 0.5  # rad, displacement of its goal from the mean
SAMPLES = 25
ROUNDS = 3  # of the closed loop


def draw_robot(axes: Axes, motion: PlanarMotion, node: int, alpha: float, color: str = BLUE) -> None:
    """Draw the satellite and both arms at a node of a motion."""
    half, angle = ROBOT.satellite.box[0], motion.angle[node]
    corners = half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1], [0, 0], [1, -1]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    square = corners[:5] @ turn.T + motion.position[node, :2]
    axes.fill(*square.T, facecolor=color, edgecolor=color, alpha=0.25 * alpha)
    axes.plot(*square.T, color=color, alpha=alpha, lw=1.2)
    up = np.array([[0.0, 0.0], [0.0, half]]) @ turn.T + motion.position[node, :2]
    axes.plot(*up.T, color=color, alpha=alpha, lw=1.2)
    for arm in motion.points[node]:
        axes.plot(*arm.T, "-o", color=color, alpha=alpha, lw=2.4, ms=3.5)
        axes.plot(*arm[-1], "D", color=VERMILION, alpha=alpha, ms=5)


def draw_motion(axes: Axes, motion: PlanarMotion, title: str, note: str) -> None:
    """Draw a motion as three poses, faint to strong, with the path of end-effector 1."""
    for node, alpha in zip((0, len(motion.time) // 2, -1), (0.25, 0.45, 1.0), strict=True):
        draw_robot(axes, motion, node, alpha)
    axes.plot(*motion.points[:, 0, -1].T, "--", color=VERMILION, lw=1)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(title, loc="center")
    axes.text(0.5, -0.02, note, transform=axes.transAxes, ha="center", va="top", fontsize=9)


def draw_pair(figure: Figure, *panels: tuple[PlanarMotion, str, str]) -> None:
    """Draw two motions (motion, title, note) next to each other at the same scale."""
    for axes, panel in zip(figure.subplots(1, 2, sharex=True, sharey=True), panels, strict=True):
        draw_motion(axes, *panel)


def free_floating(figure: Figure) -> None:
    """The same joint motion with the base held and with the base free."""
    held, free = swing(base_held=True), swing()
    distance = np.linalg.norm(free.points[-1, 0, -1] - held.points[-1, 0, -1])
    note = f"base rotates by {abs(free.rotation):.0f} deg,\nend-effector ends {distance:.1f} m away"
    draw_pair(figure, (held, "base held", "base at rest"), (free, "base free", note))


def base_disturbance(figure: Figure) -> None:
    """The same joint path in three durations: attitude and its rate over time, with the cost of eq. 20."""
    attitude, rate = figure.subplots(2, 1)
    for duration, color, dash in ((10.0, VERMILION, "-"), (20.0, BLUE, "--"), (40.0, GREEN, ":")):
        motion = swing(duration)
        label = f"{duration:.0f} s: {1e4 * motion.cost:.0f} cm²/s"
        degrees = np.degrees(motion.angle)
        attitude.plot(motion.time, degrees, dash, color=color, lw=2, label=label)
        rate.plot(motion.time, np.gradient(degrees, motion.time), dash, color=color, lw=2)
    attitude.set(ylabel="attitude [deg]")
    rate.set(ylabel="angular velocity [deg/s]", xlabel="time [s]")
    attitude.legend(title="duration: base disturbance (eq. 20)", title_fontsize=9)
    for axes in (attitude, rate):
        axes.grid()


def generalized_jacobian(axes: Axes) -> None:
    """Path of an end-effector that is asked to move straight, with either Jacobian."""
    right, wrong = straight_line(generalized=True), straight_line(generalized=False)
    draw_robot(axes, right, 0, 0.25)
    draw_robot(axes, right, -1, 1.0)
    start = right.points[0, 0, -1]
    ends = np.array([start, start + LINE])
    axes.plot(*ends.T, color=INK, lw=5, alpha=0.2, label="commanded")
    axes.plot(*right.points[:, 0, -1].T, color=GREEN, lw=2, label="generalised Jacobian")
    axes.plot(*wrong.points[:, 0, -1].T, "--", color=VERMILION, lw=2, label="Jacobian of a fixed base")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def reaction_null_space(figure: Figure) -> None:
    """Joint rates as commanded, and projected onto the reaction null space."""
    raw, projected = swing(), reactionless_swing()
    peak = np.degrees(np.abs(projected.angle).max())  # at any time
    draw_pair(
        figure,
        (raw, "as commanded", f"base rotates by {abs(raw.rotation):.0f} deg"),
        (projected, "projected", f"base rotates by {peak:.3f} deg"),
    )


def nonholonomy(figure: Figure) -> None:
    """A closed loop of two joints, and the attitude over three rounds of it."""
    motion, ends = loops(ROUNDS), np.arange(ROUNDS + 1) * (NODES - 1)
    joints, attitude = figure.subplots(1, 2)
    joints.plot(*np.degrees(motion.q[:, :2]).T, color=BLUE, lw=2)
    joints.plot(*np.degrees(planar_robot().home[:2]), "o", color=VERMILION, ms=7)
    joints.set(xlabel="joint 1 [deg]", ylabel="joint 2 [deg]", aspect="equal", title="joint angles")
    degrees = np.degrees(motion.angle)
    attitude.plot(motion.time, degrees, color=BLUE, lw=2)
    attitude.plot(motion.time[ends], degrees[ends], "o", color=VERMILION, ms=7)
    attitude.set(xlabel="time [s]", ylabel="attitude [deg]")
    attitude.set_title(f"{motion.rotation / ROUNDS:+.1f} deg per round")
    for axes in (joints, attitude):
        axes.grid()


def movement_primitives(figure: Figure) -> None:
    """A ProMP before and after conditioning on a goal, for one joint."""
    prior = prior_of(find_robot("shyam2020"))
    goal = prior.position(1.0)[JOINT] + GOAL
    conditioned = prior.condition_on([ViaPoint(1.0, [goal], dofs=[JOINT])])
    both = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, promp, title in zip(both, (prior, conditioned), ("learned", "conditioned"), strict=True):
        _draw_distribution(axes, promp)
        axes.set(xlabel="phase", title=title, xticks=(0.0, 0.5, 1.0))
        axes.grid()
    both[1].plot(1.0, np.degrees(goal), "D", color=VERMILION, ms=7, zorder=5, clip_on=False)
    both[0].set(ylabel=f"joint {JOINT + 1} [deg]")


def _draw_distribution(axes: Axes, promp: ProMP) -> None:
    """Draw samples, mean and twice the standard deviation of one joint."""
    phase = np.linspace(0.0, 1.0, 101)
    mean, covariance = promp.state(phase, 1.0)
    center, spread = np.degrees(mean[:, JOINT]), 2.0 * np.degrees(np.sqrt(covariance[:, JOINT, JOINT]))
    weights = promp.sample(np.random.default_rng(0), SAMPLES)
    samples = np.degrees(promp.trajectories(weights, phase, 1.0).position[..., JOINT])
    axes.plot(phase, samples.T, color=BLUE, lw=0.5, alpha=0.5)
    axes.fill_between(phase, center - spread, center + spread, color=BLUE, alpha=0.2, lw=0)
    axes.plot(phase, center, color=BLUE, lw=2.2)


# Name of the picture, its function, whether it draws on the whole figure, height in inches.
PICTURES: dict[str, tuple[Callable[..., None], bool, float]] = {
    "primer_free_floating": (free_floating, True, 2.9),
    "primer_base_disturbance": (base_disturbance, True, 4.2),
    "primer_generalized_jacobian": (generalized_jacobian, False, 3.2),
    "primer_reaction_null_space": (reaction_null_space, True, 2.9),
    "primer_nonholonomy": (nonholonomy, True, 2.9),
    "primer_promp": (movement_primitives, True, 2.9),
}


def picture(name: str) -> str:
    """One of `PICTURES` as an SVG file."""
    draw, whole, height = PICTURES[name]
    return draw_panel(name, draw, str(draw.__doc__), LONE, height, whole).standalone_svg()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(prog="python -m docs.primer", description=__doc__)
    parser.add_argument(
        "--output", type=output_path, default=IMAGES, metavar="DIR", help="folder (default: docs/images)"
    )
    output: Path = parser.parse_args(arguments).output
    for name in PICTURES:
        atomic_write_text(output / f"{name}.svg", picture(name))
        print(output / f"{name}.svg")
    return 0


if __name__ == "__main__":
    sys.exit(exit_status("python -m docs.primer", main))
