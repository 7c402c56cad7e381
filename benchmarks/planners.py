"""Planning time against base disturbance (eq. 20) and final attitude error of the single arm's planners."""

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from agents.commands.evaluate import main as evaluate
from agents.commands.robots import add_robot, robot_keywords, robot_words
from agents.policies.registry import policies_for
from benchmarks.arguments import env_id, goal_kind, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.evaluation.leaderboard.row import BASELINES
from space_envs.evaluation.report.drawing.labels import label_points
from space_envs.evaluation.report.drawing.look import BLUE, VERMILION
from space_envs.evaluation.report.drawing.ticks import log_ticks
from space_envs.system.command_line import Parser, exit_status
from space_envs.system.files import atomic_write
from space_envs.tasks.goals.kinds import GOAL_KINDS

ENV = "SpaceCapture/SingleArm-v0"
NO_PLANNERS = (*BASELINES, "gjm", "bc", "ppo")
ATTITUDE_METRIC = "capture@0.1deg"  # at least 0.5: the planner constrains the final attitude


class ScatterPlot(NamedTuple):
    """A scatter plot of planners: a value of leaderboard rows over another one, both on logarithmic axes.

    Attributes:
        x, y: values. x_label, y_label: with units. least: smallest value that is drawn along y.
    """

    x: Callable[[dict[str, Any]], float]
    x_label: str
    y: Callable[[dict[str, Any]], float]
    y_label: str
    least: float = 1e-4


def planning_time(row: dict[str, Any]) -> float:
    """Milliseconds before the first action."""
    return float(row["timing"]["planning_ms"])


def figure_of(key: str, scale: float = 1.0) -> Callable[[dict[str, Any]], float]:
    """A metric of rows, times a scale."""
    return lambda row: scale * row["figures"][key]["value"]


PLANNING = planning_time, "planning time [ms]"
DISTURBANCE = figure_of("attitude_cost", 1e4), "base disturbance, eq. 20 [cm²/s]"
PEAK = figure_of("peak_attitude"), "peak attitude [deg]"
# Panels of the figures by the names of their files.
FIGURES = {
    "planners": (
        ScatterPlot(*PLANNING, *DISTURBANCE),
        ScatterPlot(*PLANNING, figure_of("final_attitude"), "final attitude error [deg]"),
    ),
    "peak_attitude": (
        ScatterPlot(figure_of("time_to_capture"), "time to capture [s]", *PEAK),
        ScatterPlot(*PLANNING, *PEAK),
    ),
}
# Alternative texts of the figures in README.md and docs/.
CAPTION = (
    "Planning time against base disturbance (eq. 20) and against final attitude error, for the planners "
    f"of {ENV}; squares constrain the final attitude."
)
PEAK_CAPTION = (
    "Time to capture and planning time against the satellite's peak attitude, for the planners "
    f"of {ENV}; squares constrain the final attitude."
)


def summary(
    env: str, output: Path, episodes: int, split: str, robot: Mapping[str, Any], omitted: Sequence[str]
) -> list[dict[str, Any]]:
    """Leaderboard rows of all policies that fit an id with a robot, evaluated on medium goals.

    Args:
        robot: keywords of the task that choose it, and its kind of goals. omitted: names of policies.
    """
    names = [name for name in policies_for(env, keywords=robot) if name not in omitted]
    arguments = ["--env", env, "--policy", *names, "--split", split, "--episodes", str(episodes)]
    arguments += [word for name, value in robot.items() for word in (f"--{name}", value)]
    with redirect_stdout(sys.stderr):  # the table below is the output of this command
        status = evaluate([*arguments, "--output", str(output), "--no-pictures", "--overwrite"])
    if status != 0:
        raise SystemExit(status)
    return json.loads((output / "summary.json").read_text())["rows"]


def goal_rows(options: argparse.Namespace, robot: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Rows of all policies but baselines, for each kind of goals, those of a policy next to each other."""
    rows: list[dict[str, Any]] = []
    for kind in options.goals:
        keywords, output = {**robot, "goal": kind}, options.output / f"goals-{kind}"
        rows += summary(options.env, output, options.episodes, options.split, keywords, BASELINES)
    by_cost = sorted(rows, key=lambda row: DISTURBANCE[0](row) if row["captures"] else math.inf)
    order = list(dict.fromkeys(row["policy"] for row in by_cost))
    return sorted(rows, key=lambda row: order.index(row["policy"]))


def print_goals(options: argparse.Namespace, robot: Mapping[str, Any]) -> None:
    """Print the table of policies and kinds of goals."""
    table = []
    for row in goal_rows(options, robot):
        planning, cells = row["timing"]["planning_ms"], ["-", "-"]
        if row["captures"]:
            cells = [f"{DISTURBANCE[0](row):.1f}", f"{PEAK[0](row):.3g}"]
        captured = [100 * row["figures"][key]["value"] for key in ("success", ATTITUDE_METRIC)]
        table.append([row["policy"], row["goal"], *(f"{share:.0f}" for share in captured), *cells])
        table[-1].append("-" if planning is None else f"{planning:.1f}")
    head = ["policy", "goal", "captured, %", "captured within 0.1 deg, %"]
    head += ["base disturbance (eq. 20), cm^2/s", "peak attitude, deg", "planning, ms"]
    print(markdown_table(head, table))
    print(f"\n{options.episodes} medium {options.split} goals{robot_words(robot)}, {machine_class()}.")


def draw(rows: list[dict[str, Any]], panels: Sequence[ScatterPlot], path: Path) -> None:
    """Draw panels next to each other; planners that constrain the final attitude are orange squares."""
    matplotlib.rcParams["svg.hashsalt"] = "planners"
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    labels: list[tuple[Axes, list[tuple[str, float, float]]]] = []
    for number, panel in enumerate(panels):
        axes: Axes = figure.add_subplot(1, 2, number + 1)
        points = []
        for row in rows:
            x, y = panel.x(row), max(panel.y(row), panel.least)
            constrained = row["figures"][ATTITUDE_METRIC]["value"] >= 0.5
            marker, color = ("s", VERMILION) if constrained else ("o", BLUE)
            label = "final attitude constrained" if constrained else "final attitude unconstrained"
            axes.plot(x, y, marker, color=color, ms=7, label=label)
            points.append((row["policy"], x, y))
        axes.set(xscale="log", yscale="log", xlabel=panel.x_label, ylabel=panel.y_label)
        axes.margins(0.12)
        for axis in (axes.xaxis, axes.yaxis):
            log_ticks(axis, most=7)
        axes.grid(alpha=0.3)
        labels.append((axes, points))
    legend = dict(zip(*reversed(figure.axes[0].get_legend_handles_labels()), strict=True))
    figure.legend(legend.values(), legend.keys(), loc="outside upper left", ncols=2, frameon=False)
    for axes, points in labels:
        label_points(axes, points)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})


def main() -> None:
    """Evaluate the planners, print the table and draw the figure."""
    parser = Parser(prog="python -m benchmarks.planners", description=__doc__)
    parser.add_argument("--env", type=env_id, default=ENV, help="id; the plot is drawn for %(default)s alone")
    parser.add_argument("--episodes", type=whole, default=100, help="test goals (default %(default)s)")
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    parser.add_argument("--output", type=Path, default=Path("results/planners"), help="default %(default)s")
    parser.add_argument(
        "--plots",
        type=Path,
        help="folder of the figures (default: the output folder); docs/images has its own",
    )
    what = f"compare goals of these kinds, for every policy that acts: {', '.join(GOAL_KINDS)}"
    parser.add_argument("--goals", nargs="+", type=goal_kind, metavar="KIND", help=what)
    add_robot(parser.add_argument)
    options = parser.parse_args()
    robot = robot_keywords(options)
    if options.goals:
        print_goals(options, robot)
        return
    evaluated = summary(options.env, options.output, options.episodes, options.split, robot, NO_PLANNERS)
    rows = [row for row in evaluated if row["captures"]]  # without a capture there is no cost
    if options.env == ENV:
        for name, panels in FIGURES.items():
            draw(rows, panels, (options.plots or options.output) / f"{name}.svg")
    table = [
        [
            row["policy"],
            f"{planning_time(row):.1f}",
            f"{1e4 * row['figures']['attitude_cost']['value']:.1f}",
            f"{row['figures']['final_attitude']['value']:.3g}",
            f"{row['figures']['peak_attitude']['value']:.3g}",
            f"{row['figures']['time_to_capture']['value']:.1f}",
            f"{100 * row['figures']['success']['value']:.0f}",
            f"{100 * row['figures'][ATTITUDE_METRIC]['value']:.0f}",
        ]
        for row in sorted(rows, key=lambda row: row["figures"]["attitude_cost"]["value"])
    ]
    head = ["planner", "planning, ms", "base disturbance (eq. 20), cm^2/s", "final attitude error, deg"]
    head += ["peak attitude, deg", "time to capture, s"]
    head += ["captured, %", "captured within 0.1 deg, %"]
    print(markdown_table(head, table))
    print(f"\n{options.episodes} medium {options.split} goals{robot_words(robot)}, {machine_class()}.")
    if len(rows) < len(evaluated):
        print(f"Without a capture: {', '.join(row['policy'] for row in evaluated if not row['captures'])}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.planners", main))
