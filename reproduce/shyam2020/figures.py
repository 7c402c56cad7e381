"""Figures 2 to 6 of the paper from our runs, and how the planners compare over the goals."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from agents.policies.single_arm.promp import shipped_prior
from reproduce.compare import Record, figures_of, ratio
from reproduce.figures import Figure, Sketch, figure
from reproduce.shyam2020.cases import context
from reproduce.shyam2020.measures import link_vectors
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.runs import Worked
from reproduce.shyam2020.sampling import SHOWN, Drawn
from space_envs.dynamics.rotations import Array, rotate
from space_envs.dynamics.spheres import link_ends
from space_envs.evaluation.report.drawing import INK
from space_envs.evaluation.report.figures import BLUE, GREEN, SKY, VERMILION
from space_envs.robots.parameters import SINGLE_ARM

AXES = "xyz"
COLOURS = (BLUE, VERMILION, GREEN)
DASHES = ("-", (0, (4, 1.6)), (0, (1.2, 1.2)))
EVERY = 10  # samples of a course between those that are drawn
NEAR = "offset points"
LETTERS = {key: "abcdefgh"[number] for number, key in enumerate(METHODS)}  # on narrow panels


def vectors() -> Figure:
    """Fig. 2: the vectors of the kinematics at home, in the satellite's axes."""
    found = link_vectors(context().arm.home)
    joints, centres = found.joint, found.centre

    def sketch(view: Callable[[Array], Array], name: str, labels: tuple[str, str]) -> Sketch:
        def arrow(axes: Axes, start: Array, end: Array, colour: str, style: str) -> None:
            look = {"arrowstyle": "-|>", "color": colour, "lw": 1.4, "ls": style, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", _place(view(end)), _place(view(start)), arrowprops=look)

        def draw(axes: Axes) -> None:
            still = np.array([1.0, 0.0, 0.0, 0.0])
            for edge in _cube(centres[0], still):
                axes.plot(*view(edge).T, color=INK, lw=0.8, alpha=0.4)
            axes.plot(*view(joints).T, "o", color=INK, ms=5)
            axes.plot(*view(centres).T, "o", color=INK, ms=4, mfc="none")
            axes.plot(0.0, 0.0, "+", color=INK, ms=11, mew=1.6)
            for number, centre in enumerate(centres):
                arrow(axes, np.zeros(3), centre, SKY, "--")
                axes.annotate(f"r{_low(number)}", _place(view(centre)), (4, 3), textcoords=NEAR, fontsize=8)
            for centre, inward in zip(centres[1:], found.inward, strict=True):
                arrow(axes, centre - inward, centre, BLUE, "-")
            for centre, outward in zip(centres, found.outward, strict=True):
                arrow(axes, centre, centre + outward, VERMILION, "-")
            for colour, style, label in ((BLUE, "-", "a"), (VERMILION, "-", "b"), (SKY, "--", "r")):
                axes.plot([], [], color=colour, ls=style, label=label)
            axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel=labels[0], ylabel=labels[1])
            axes.legend(fontsize=8, loc="lower right")

        return Sketch(draw, name)

    return figure(
        "fig2",
        "Fig. 2: vectors of the spacecraft-manipulator arm",
        "At home, read from the model that is simulated. Cross: the system's centre of mass, the origin of "
        "the inertial frame; dots: joints and the end-effector; circles: centres of mass of the satellite "
        "(0) and of the links. a leads from a joint to its link's centre of mass, b from there to the next "
        "joint, r from the origin to each centre of mass, so that r of a link is that of the one before "
        "plus b and a (eq. 4).",
        (
            sketch(lambda p: p[..., [1, 2]], "The vectors seen along x.", ("y [m]", "z [m]")),
            sketch(lambda p: p[..., [0, 2]], "The vectors seen along y.", ("x [m]", "z [m]")),
        ),
        columns=2,
        height=3.6,
    )


def trajectories(worked: Worked, drawn: Drawn) -> Figure:
    """Fig. 3: home and goal pose and the end-effector's ways, seen along two axes and from aside."""
    best = int(np.argmin(drawn.cost[:SHOWN]))
    arms = [
        link_ends(context().arm, drawn.motion.position[best, k], drawn.base[best, k], drawn.attitude[best, k])
        for k in (0, -1)
    ]
    cube = [_cube(drawn.base[best, k], drawn.attitude[best, k]) for k in (0, -1)]

    def sketch(view: Callable[[Array], Array], name: str, labels: tuple[str, str]) -> Sketch:
        def draw(axes: Axes) -> None:
            for number, (edges, arm) in enumerate(zip(cube, arms, strict=True)):
                shade = 0.4 if number == 0 else 1.0
                for edge in edges:
                    axes.plot(*view(edge).T, color=INK, lw=0.8, alpha=0.5 * shade)
                axes.plot(*view(arm).T, "o-", color=INK, lw=2.6, ms=4, alpha=shade)
            for number in range(SHOWN):
                axes.plot(*view(drawn.tip[number]).T, color=SKY, lw=1.0, alpha=0.8)
            axes.plot(*view(drawn.tip[best]).T, color=VERMILION, lw=2.2)
            goal = view(worked.case.position)
            axes.plot(goal[0], goal[1], "*", color=GREEN, ms=11)
            axes.set_aspect("equal")
            axes.set(xlabel=labels[0], ylabel=labels[1])

        return Sketch(draw, f"{name}.")

    length = np.linalg.norm(np.diff(drawn.tip[:SHOWN], axis=1), axis=2).sum(axis=1)
    told = (
        f"The arm at home (faint) and at the goal, and {SHOWN} ways of the end-effector of "
        f"{length.min():.2f} "
        f"to {length.max():.2f} m; the cheapest is thick"
    )
    return figure(
        "fig3",
        "Fig. 3: home and goal pose, conditioned trajectories of the end-effector",
        f"{SHOWN} samples of the ProMP conditioned on start and goal, as inertial trajectories of the "
        "end-effector of the floating robot; red: the one of least eq. 20; star: the goal. Faint: the "
        "robot at "
        "home.",
        (
            sketch(_oblique, told, ("along [m]", "up [m]")),
            sketch(lambda p: p[..., [1, 2]], "The same seen along x", ("y [m]", "z [m]")),
            sketch(lambda p: p[..., [0, 2]], "The same seen along y", ("x [m]", "z [m]")),
        ),
        height=3.6,
    )


def costs(worked: Worked, drawn: Drawn) -> Figure:
    """Fig. 4: the cost of each of the twenty, the least marked; and of all hundred beside the planners'."""
    shown = 1e4 * drawn.cost[:SHOWN]
    best = int(shown.argmin())

    def bars(axes: Axes) -> None:
        colours = [VERMILION if k == best else SKY for k in range(SHOWN)]
        axes.bar(np.arange(1, SHOWN + 1), shown, color=colours, width=0.7)
        axes.annotate(
            "least",
            (best + 1, shown[best]),
            (best + 1, 1.08 * shown.max()),
            ha="center",
            arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.7},
        )
        axes.set(xlabel="trajectory", ylabel="eq. 20 cost [cm²/s]")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        axes.grid(axis="y")

    def spread(axes: Axes) -> None:
        axes.hist(1e4 * drawn.cost, bins=20, color=SKY, alpha=0.8)
        top = axes.get_ylim()[1]
        names = ("minimum_jerk", "promp_mean", "promp", "promp_optimal", "ocp")
        for number, key in enumerate(name for name in names if name in worked.courses):
            value = 1e4 * worked.courses[key].cost
            axes.axvline(
                value, color=METHODS[key].colour, lw=1.8, ls=DASHES[number % 3], label=METHODS[key].name
            )
        axes.set(xlabel="eq. 20 cost [cm²/s]", ylabel="samples", xlim=(0, None), ylim=(0, 1.75 * top))
        axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.legend(fontsize=8, loc="upper right")

    return figure(
        "fig4",
        "Fig. 4: cost of each sampled trajectory",
        "Left: the twenty of Fig. 3, the least marked. Right: all 100 that the algorithm draws, and what the "
        "planners' motions to the same inertial goal cost. Eq. 20 times the time step, c = 1 m/rad.",
        (
            Sketch(
                bars,
                f"Costs of {SHOWN} samples: {shown.min():.1f} to {shown.max():.1f} cm²/s, least at number "
                f"{best + 1}.",
            ),
            Sketch(spread, f"Costs of 100 samples: from {1e4 * drawn.cost.min():.1f} cm²/s on."),
        ),
        columns=2,
        height=3.1,
    )


def base_motion(worked: Worked, key: str, name: str, title: str, what: str) -> Figure | None:
    """Fig. 5, of one method: rotation and translation of the base."""
    if key not in worked.courses:
        return None
    course = worked.courses[key]

    def panel(values: Array, label: str, unit: str) -> Sketch:
        def draw(axes: Axes) -> None:
            for number, axis in enumerate(AXES):
                axes.plot(
                    course.time[::EVERY],
                    values[::EVERY, number],
                    color=COLOURS[number],
                    ls=DASHES[number],
                    lw=1.9,
                    label=axis,
                )
            axes.set(xlabel="time [s]", ylabel=f"{label} [{unit}]", xlim=(0, course.time[-1]))
            axes.grid()
            axes.legend(ncols=3)

        end = ", ".join(f"{value:+.2f}" for value in values[-1])
        return Sketch(draw, f"{label}: at the end {end} {unit}, at most {np.abs(values).max():.2f} {unit}.")

    return figure(
        name,
        title,
        f"{what} Rotation vector of the base from its first attitude, and displacement of its centre of "
        "mass, "
        f"inertial axes. Eq. 20: {1e4 * course.cost:.2f} cm²/s; attitude at the end "
        f"{np.rad2deg(course.angle[-1]):.3f} deg, at most {np.rad2deg(course.angle.max()):.3f} deg.",
        (
            panel(np.rad2deg(course.rotation), "rotation", "deg"),
            panel(100 * course.base, "translation", "cm"),
        ),
        columns=2,
        height=2.9,
    )


def basis() -> Figure:
    """Fig. 6: the basis functions."""
    functions = shipped_prior().basis
    phase = np.linspace(0.0, 1.0, 201)
    values = functions.value(phase)

    def draw(axes: Axes) -> None:
        for number in range(functions.size):
            axes.plot(phase, values[:, number], color=(*COLOURS, SKY)[number % 4], lw=1.9)
        axes.set(xlabel="phase", ylabel="ψ", xlim=(0, 1), ylim=(0, 1.05))
        axes.grid()

    centres = ", ".join(f"{centre:g}" for centre in functions.centres)
    return figure(
        "fig6",
        "Fig. 6: radial basis functions",
        f"Ten functions exp(-(z - c)² / h²) with the paper's centres {centres}; h = {functions.bandwidth:g}, "
        "which the paper does not give.",
        (
            Sketch(
                draw,
                f"{functions.size} bell curves over the phase from 0 to 1, overlapping their neighbours.",
            ),
        ),
        height=2.9,
    )


def compared(records: Sequence[Record]) -> Figure:
    """Costs against optimal control, end attitudes, and planning times over the goals."""

    def ratios(axes: Axes) -> None:
        for key, method in METHODS.items():
            values = ratios_to(records, key)
            if key != "ocp" and values.size:
                share = 100 * (np.arange(values.size) + 1) / values.size
                axes.step(np.sort(values), share, color=method.colour, lw=1.9, label=LETTERS[key])
        axes.axvline(1.0, color=INK, lw=0.8, ls=DASHES[1])
        axes.set(xlabel="eq. 20 over that of optimal control", ylabel="goals up to here [%]", xscale="log")
        _plain(axes, "x")
        axes.legend(ncols=2, fontsize=8, loc="lower right")
        axes.grid()

    def attitudes(axes: Axes) -> None:
        _strips(axes, records, lambda f, record, key: max(np.rad2deg(f["end_attitude"]), 1e-5))
        axes.set(xlabel="end attitude [deg]", xscale="log")

    def planning(axes: Axes) -> None:
        _strips(axes, records, lambda f, record, key: 1000 * record["timing"][key])
        axes.set(xlabel="planning [ms]", xscale="log")

    names = "; ".join(f"{LETTERS[key]} {method.name}" for key, method in METHODS.items())
    medians = "; ".join(
        f"{method.name} {np.median(values):.2f}"
        for key, method in METHODS.items()
        if (values := ratios_to(records, key)).size
    )
    return figure(
        "compared",
        "How the planners compare over the goals",
        f"{names}. Left: distribution functions of eq. 20 over that of optimal control with the "
        "attitude free. "
        "Middle and right: one dot for each goal, a bar at the median; attitudes below 1e-5 deg are drawn "
        "there.",
        (
            Sketch(ratios, f"Median of eq. 20 over that of optimal control: {medians}."),
            Sketch(attitudes, "End attitudes of all planners over the goals."),
            Sketch(planning, "Planning times of all planners over the goals."),
        ),
        height=3.3,
    )


def ratios_to(records: Sequence[Record], key: str, other: str = "ocp") -> Array:
    """Costs of a method over another's, of the goals where both have a motion."""
    found = [ratio(record, key, (other,), "cost") for record in records]
    return np.array([value for value in found if value is not None])


def _strips(axes: Axes, records: Sequence[Record], value: Callable[..., float]) -> None:
    """A row of dots for each method."""
    shift = np.random.default_rng(0).uniform(-0.22, 0.22, len(records))
    for number, (key, method) in enumerate(METHODS.items()):
        found = [
            (value(f, record, key), shift[row])
            for row, record in enumerate(records)
            if (f := figures_of(record, key))
        ]
        if not found:
            continue
        points = np.array(found)
        axes.plot(points[:, 0], number + points[:, 1], "o", color=method.colour, ms=3, alpha=0.55, mew=0)
        middle = float(np.median(points[:, 0]))
        axes.plot([middle, middle], [number - 0.34, number + 0.34], color=INK, lw=1.8)
    axes.set_yticks(range(len(METHODS)), [LETTERS[key] for key in METHODS])
    axes.set_ylim(len(METHODS) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="x")


def _plain(axes: Axes, which: str) -> None:
    axis = getattr(axes, f"{which}axis")
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(
        FuncFormatter(lambda value, _: f"{value:g}" if value in (0.5, 2.0, 3.0, 5.0) else "")
    )


def _place(point: Array) -> tuple[float, float]:
    """A point of a drawing."""
    return float(point[0]), float(point[1])


def _low(number: int) -> str:
    """A digit as a subscript."""
    return chr(0x2080 + number)


def _oblique(points: Array) -> Array:
    """Seen from in front, to the right and above."""
    turn, lift = np.deg2rad(-35.0), np.deg2rad(20.0)
    along = np.cos(turn) * points[..., 1] + np.sin(turn) * points[..., 0]
    away = -np.sin(turn) * points[..., 1] + np.cos(turn) * points[..., 0]
    return np.stack([along, np.cos(lift) * points[..., 2] - np.sin(lift) * away], axis=-1)


def _cube(position: Array, quaternion: Array) -> list[Array]:
    """The edges (2, 3) of the bus."""
    half = 0.5 * SINGLE_ARM.satellite_side
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    placed = position + rotate(quaternion, corners)
    return [
        placed[[a, b]]
        for a in range(8)
        for b in range(a + 1, 8)
        if np.count_nonzero(corners[a] - corners[b]) == 1
    ]
