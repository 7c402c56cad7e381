"""Figures 2 and 3 of shyam2020: vectors, sampled paths, and home and goal pose as MuJoCo draws them."""

import io
from collections.abc import Callable

import mujoco
import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from reproduce.page.blocks import Picture, Prose
from reproduce.page.drawing import place_axes
from reproduce.page.figures import Draw, Figure, figure
from reproduce.shyam2020.cases import DIFFICULTY, GoalCase, context
from reproduce.shyam2020.measures import Course, LinkVectors, link_vectors
from reproduce.shyam2020.page.text import TEXT
from reproduce.shyam2020.runs import PlannedGoal
from reproduce.shyam2020.sampling import SHOWN, DrawnSamples
from space_envs.dynamics.rotations import Array, rotate
from space_envs.dynamics.spheres import link_ends
from space_envs.errors import RenderingError
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, SKY, VERMILION
from space_envs.evaluation.report.drawing.panel import INK
from space_envs.tasks.single_arm import SingleArmTask

View = Callable[[Array], Array]  # from points (..., 3) to coordinates (..., 2) of a drawing
WIDTH, HEIGHT = 720, 540  # of each of the two
QUALITY = 88
STILL = np.array([1.0, 0.0, 0.0, 0.0])


def along_x(points: Array) -> Array:
    """Coordinates (..., 2) of points (..., 3) seen along x: y to the right, z up."""
    return points[..., [1, 2]]


def along_y(points: Array) -> Array:
    """Coordinates (..., 2) of points (..., 3) seen along y: x to the right, z up."""
    return points[..., [0, 2]]


def oblique(points: Array) -> Array:
    """Coordinates (..., 2) of points (..., 3) seen obliquely, from the front right and above."""
    pan, lift = np.deg2rad(-35.0), np.deg2rad(20.0)
    along = np.cos(pan) * points[..., 1] + np.sin(pan) * points[..., 0]
    away = -np.sin(pan) * points[..., 1] + np.cos(pan) * points[..., 0]
    return np.stack([along, np.cos(lift) * points[..., 2] - np.sin(lift) * away], axis=-1)


def vectors() -> Figure:
    """Fig. 2: the vectors of the kinematics at home, in the satellite's axes."""
    found = link_vectors(context().arm.home)
    draws = (
        lambda axes: _draw_vectors(axes, found, along_x, ("y [m]", "z [m]")),
        lambda axes: _draw_vectors(axes, found, along_y, ("x [m]", "z [m]")),
    )
    return figure("fig2", TEXT.fill("figures.fig2"), draws, columns=2, height=3.6)


def _draw_vectors(axes: Axes, found: LinkVectors, view: View, labels: tuple[str, str]) -> None:
    joints, centres = found.joint, found.centre

    def arrow(start: Array, end: Array, color: str, style: str) -> None:
        look = {"arrowstyle": "-|>", "color": color, "lw": 1.4, "ls": style, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", _point(view(end)), _point(view(start)), arrowprops=look)

    for edge in _cube(centres[0], STILL):
        axes.plot(*view(edge).T, color=INK, lw=0.8, alpha=0.4)
    axes.plot(*view(joints).T, "o", color=INK, ms=5)
    axes.plot(*view(centres).T, "o", color=INK, ms=4, mfc="none")
    axes.plot(0.0, 0.0, "+", color=INK, ms=11, mew=1.6)
    for number, centre in enumerate(centres):
        arrow(np.zeros(3), centre, SKY, "--")
        name = f"r{chr(0x2080 + number)}"  # its number as a subscript
        axes.annotate(name, _point(view(centre)), (4, 3), textcoords="offset points", fontsize=8)
    for centre, inward in zip(centres[1:], found.inward, strict=True):
        arrow(centre - inward, centre, BLUE, "-")
    for centre, outward in zip(centres, found.outward, strict=True):
        arrow(centre, centre + outward, VERMILION, "-")
    for color, style, label in ((BLUE, "-", "a"), (VERMILION, "-", "b"), (SKY, "--", "r")):
        axes.plot([], [], color=color, ls=style, label=label)
    place_axes(axes, labels, adjustable="datalim")
    axes.legend(fontsize=8, loc="lower right")


def trajectories(planned: PlannedGoal, drawn: DrawnSamples) -> Figure:
    """Fig. 3: home and goal pose and the end-effector's paths, seen along two axes and obliquely."""
    length = np.linalg.norm(np.diff(drawn.end_effector[:SHOWN], axis=1), axis=2).sum(axis=1)
    text = TEXT.fill("figures.fig3", shortest=length.min(), longest=length.max())
    draws = (
        _paths(planned, drawn, oblique, ("along [m]", "up [m]")),
        _paths(planned, drawn, along_x, ("y [m]", "z [m]")),
        _paths(planned, drawn, along_y, ("x [m]", "z [m]")),
    )
    return figure("fig3", text, draws, height=3.6)


def _paths(planned: PlannedGoal, drawn: DrawnSamples, view: View, labels: tuple[str, str]) -> Draw:
    """Function that draws the arm at home and at the goal, and the paths of the samples."""
    best = int(np.argmin(drawn.cost[:SHOWN]))

    def draw(axes: Axes) -> None:
        for sample, opacity in ((0, 0.4), (-1, 1.0)):
            base, attitude = drawn.base[best, sample], drawn.attitude[best, sample]
            for edge in _cube(base, attitude):
                axes.plot(*view(edge).T, color=INK, lw=0.8, alpha=0.5 * opacity)
            arm = link_ends(context().arm, drawn.motion.position[best, sample], base, attitude)
            axes.plot(*view(arm).T, "o-", color=INK, lw=2.6, ms=4, alpha=opacity)
        for number in range(SHOWN):
            axes.plot(*view(drawn.end_effector[number]).T, color=SKY, lw=1.0, alpha=0.8)
        axes.plot(*view(drawn.end_effector[best]).T, color=VERMILION, lw=2.2)
        goal = view(planned.case.position)
        axes.plot(goal[0], goal[1], "*", color=GREEN, ms=11)
        place_axes(axes, labels)

    return draw


def _point(point: Array) -> tuple[float, float]:
    """A point of a drawing."""
    return float(point[0]), float(point[1])


def _cube(position: Array, quaternion: Array) -> list[Array]:
    """Edges (2, 3) of the satellite's cube, m."""
    half = np.array(context().robot.satellite.box)
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    placed = position + rotate(quaternion, corners)
    return [
        placed[[a, b]]
        for a in range(8)
        for b in range(a + 1, 8)
        if np.count_nonzero(corners[a] - corners[b]) == 1
    ]


def poses(case: GoalCase, course: Course) -> Picture | Prose:
    """The robot at home and at the end of a motion, with its path; or why there is no picture."""
    from space_envs.rendering import Renderer  # OpenGL may be missing, and is not needed without pictures

    model = SingleArmTask(difficulty=DIFFICULTY).render_model
    data = mujoco.MjData(model)
    data.mocap_pos[0], data.mocap_quat[0] = case.position, case.quaternion
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    frames = []
    try:
        with Renderer(model, width=WIDTH, height=HEIGHT, camera="overview") as renderer:
            for row, trail in ((0, None), (-1, course.end_effector[::10])):
                data.qpos[:] = np.concatenate([course.base[row], course.attitude[row], course.joints[row]])
                mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
                frames.append(renderer.render(state, trail=trail))
    except RenderingError as error:
        return Prose(*TEXT.paragraphs("texts.no_picture", error=error))
    content = io.BytesIO()
    Image.fromarray(np.concatenate(frames, axis=1)).save(content, format="JPEG", quality=QUALITY)
    return Picture("poses", **TEXT.fill("pictures.poses"), jpeg=content.getvalue())
