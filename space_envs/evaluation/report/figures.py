"""The report's figures as SVG text that goes inline into HTML.

No meaning rests on colour alone: `looks` gives each policy its colour, marker and dashes, the same in all
figures and on the page.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from space_envs.dynamics.rotations import Array
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing import INK, LONE, Panel, draw_panel, label_points
from space_envs.evaluation.report.tables import row_name
from space_envs.evaluation.report.templating import shown_unit
from space_envs.evaluation.report.ticks import is_wide, log_ticks, wide_scale
from space_envs.evaluation.statistics.columns import column_named
from space_envs.evaluation.statistics.figures import HEADLINE
from space_envs.evaluation.statistics.intervals import Estimate
from space_envs.evaluation.statistics.normalised import SCORES, Scores
from space_envs.evaluation.statistics.row import Row
from space_envs.tasks.outcome import Outcome

# Okabe and Ito without yellow, which white pages swallow, and without black, which dark ones do.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
# Then what is farthest from these and from each other, and still seen on white and on dark pages.
PALETTE = (
    *(BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY),
    *("#8a2be2", "#c2185b", "#7a5c3e", "#7d7af5", "#8c8400", "#e03ad0"),
    *("#5da800", "#f0506e", "#3f51e0", "#9a6bb0", "#a8957c", "#1f7a1f"),
)
# What matplotlib and the page's style sheet call the same shape.
SHAPES = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle", "P": "plus", "X": "cross"}
_DASHES: tuple[Any, ...] = (
    "-",
    (0, (4, 1.6)),
    (0, (1.2, 1.2)),
    (0, (7, 1.5, 1.2, 1.5)),
    (0, (2.2, 0.8)),
    (0, (9, 2)),
)
_SAFE = 6  # colours in a row that colour-blind readers can tell apart


@dataclass(frozen=True)
class Look:
    """How a policy is drawn: `marker` and `dash` as matplotlib takes them, `shape` for the style sheet."""

    colour: str
    marker: str
    dash: Any

    @property
    def shape(self) -> str:
        """The marker's name."""
        return SHAPES[self.marker]


@dataclass(frozen=True)
class Plot:
    """A figure of the report: panels beside each other where there is room, below each other where not."""

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]


def looks(policies: Sequence[str]) -> dict[str, Look]:
    """A look for each policy, in the order given.

    The first 18 have colours of their own; every six there is another marker with other dashes, so that no
    two of 36 look the same, and colour-blind readers can tell them apart.
    """
    markers = tuple(SHAPES)
    return {
        policy: Look(
            PALETTE[number % len(PALETTE)],
            markers[number // _SAFE % len(markers)],
            _DASHES[number // _SAFE % len(_DASHES)],
        )
        for number, policy in enumerate(policies)
    }


def heading_of(key: str) -> str:
    """What an axis calls a figure of the leaderboard."""
    return shown_unit(column_named(key).heading)


def intervals_plot(rows: Sequence[Row], shade: Mapping[str, Look]) -> Plot:
    """Score, success and final attitude with their 95 % intervals, one line for each row."""
    panels = []
    for key in (HEADLINE, "success", "final_attitude"):
        estimates = [row.figures[key] for row in rows]

        def dress(axes: Axes, key: str = key, estimates: list[Estimate] = estimates) -> None:
            if column_named(key).unit == "%":
                axes.set_xlim(-3, 103)
            else:
                _from_zero(axes, [estimate.value for estimate in estimates])

        scale = column_named(key).scale
        panels.append(
            _interval_panel(f"intervals-{key}", heading_of(key), rows, estimates, scale, shade, dress)
        )
    caption = (
        "Dots are the figures of the table, bars their 95 % intervals. Failures count in score and success; "
        "the attitude is over captures."
    )
    return Plot("intervals", "Score, success and attitude", caption, tuple(panels))


def scores_plot(rows: Sequence[Row], scores: Scores, shade: Mapping[str, Look]) -> Plot | None:
    """Normalised scores with their 95 % intervals, one panel for each score that exists."""
    panels = []
    scored = [row for row in rows if row.entry in scores]
    for name in SCORES:
        estimates = [scores[row.entry][name].estimate for row in scored]
        found = [estimate for estimate in estimates if estimate is not None]
        if not scored or len(found) < len(scored):
            continue

        def dress(axes: Axes) -> None:
            for reference in (0.0, 1.0):
                axes.axvline(reference, color=INK, lw=0.8, ls=(0, (4, 2)))

        title = f"score in {column_named(name).title}"
        panels.append(_interval_panel(f"scores-{name}", title, scored, found, 1.0, shade, dress))
    caption = "Dashed lines: random has 0, the best expert 1. Bars are 95 % intervals. Failures count."
    return Plot("scores", "Normalised scores", caption, tuple(panels)) if panels else None


def _interval_panel(
    key: str,
    title: str,
    rows: Sequence[Row],
    estimates: Sequence[Estimate],
    scale: float,
    shade: Mapping[str, Look],
    dress: Callable[[Axes], None],
) -> Panel:
    """A dot and a bar for each row; `dress` finishes the axes."""
    names = [row_name(row, rows) for row in rows]

    def draw(axes: Axes) -> None:
        for number, (row, estimate) in enumerate(zip(rows, estimates, strict=True)):
            if not math.isfinite(estimate.value):
                continue
            low, high = (scale * end for end in (estimate.low, estimate.high))
            look = shade[row.policy]
            if math.isfinite(low) and math.isfinite(high):
                axes.plot([low, high], [number, number], color=look.colour, lw=5, alpha=0.35)
            axes.plot(
                scale * estimate.value, number, look.marker, color=look.colour, ms=7, mew=0, clip_on=False
            )
        axes.set_yticks(range(len(rows)), [figure_name(name) for name in names])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlabel(title)
        axes.grid(axis="x")
        dress(axes)
        axes.tick_params(axis="y", length=0)

    told = (f"{display_name(n)} {scale * e.value:.3g}" for n, e in zip(names, estimates, strict=True))
    return draw_panel(key, draw, f"{title}: {', '.join(told)}", height=0.75 + 0.27 * len(rows))


def outcomes_plot(rows: Sequence[Row]) -> Plot:
    """How the episodes of each policy ended, as stacked bars."""
    shades = {
        Outcome.CAPTURED: GREEN,
        Outcome.TIMEOUT: SKY,
        Outcome.ATTITUDE_LOST: ORANGE,
        Outcome.DIVERGED: PURPLE,
        Outcome.COLLISION: VERMILION,
        Outcome.POLICY_ERROR: INK,
    }
    hatches = {Outcome.ATTITUDE_LOST: "//", Outcome.DIVERGED: "xx", Outcome.COLLISION: ".."}
    names = [row_name(row, rows) for row in rows]
    seen = [outcome for outcome in shades if any(row.outcomes[outcome] for row in rows)]

    def draw(axes: Axes) -> None:
        left = np.zeros(len(rows))
        for outcome in seen:
            share = np.array([100 * row.outcomes[outcome] / row.episodes for row in rows])
            axes.barh(
                range(len(rows)),
                share,
                left=left,
                height=0.62,
                color=shades[outcome],
                alpha=0.85,
                hatch=hatches.get(outcome, ""),
                edgecolor=INK if hatches.get(outcome) else shades[outcome],
                linewidth=0,
                label=outcome.label,
            )
            left += share
        axes.set_yticks(range(len(rows)), [figure_name(name) for name in names])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlim(0, 100)
        axes.set_xlabel("episodes [%]")
        axes.tick_params(axis="y", length=0)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, borderaxespad=0.2)

    alt = "; ".join(
        f"{display_name(name)}: " + ", ".join(f"{row.outcomes[o]} {o}" for o in seen if row.outcomes[o])
        for name, row in zip(names, rows, strict=True)
    )
    panel = draw_panel("outcomes", draw, alt, width=LONE, height=1.1 + 0.27 * len(rows))
    return Plot("outcomes", "How episodes ended", "Every episode counts once.", (panel,))


def cost_plot(rows: Sequence[Row], shade: Mapping[str, Look]) -> Plot | None:
    """Base disturbance against planning time, both logarithmic; None where no row has both."""
    points = []
    for row, name in zip(rows, (row_name(row, rows) for row in rows), strict=True):
        planning, action = row.timing["planning_ms"], row.timing["action_ms"]
        wait = planning if planning > 0 else action
        if wait > 0 and math.isfinite(row.figures["attitude_cost"].value):
            points.append((name, row, wait, planning > 0))
    positive = [row.figures["attitude_cost"].value for _, row, _, _ in points]
    positive = [value for value in positive if value > 0]
    if not positive:
        return None
    floor = min(positive) / 4
    column = column_named("attitude_cost")

    def draw(axes: Axes) -> None:
        axes.set_xscale("log")
        axes.set_yscale("log")
        labels = []
        for name, row, wait, plans in points:
            cost, look = row.figures["attitude_cost"], shade[row.policy]
            value, low, high = (column.scale * max(end, floor) for end in (cost.value, cost.low, cost.high))
            if math.isfinite(low) and math.isfinite(high):
                axes.plot([wait, wait], [low, high], color=look.colour, lw=5, alpha=0.35)
            marker = look.marker if cost.value > 0 else "v"
            face = look.colour if plans else "none"
            axes.plot(wait, value, marker, ms=8, color=look.colour, mfc=face, mew=1.8)
            labels.append((figure_name(name) + ("" if cost.value > 0 else " (0)"), wait, value))
        axes.margins(x=0.16, y=0.16)
        for axis in (axes.xaxis, axes.yaxis):
            log_ticks(axis, most=7)
        axes.set_xlabel("planning time [ms]")
        axes.set_ylabel(heading_of(column.key))
        axes.grid(which="major")
        label_points(axes, labels)

    alt = "; ".join(
        f"{display_name(name)}: {column.value(row)} {shown_unit(column.unit)}, {wait:.3g} ms"
        for name, row, wait, _ in points
    )
    caption = (
        "Filled: the time to make the plan. Hollow: policies without a plan, at the time of one action. "
        "A triangle at the lower edge: none at all. Low and left is better, for policies that capture."
    )
    panel = draw_panel("cost", draw, alt, width=LONE, height=4.0)
    return Plot("cost", "Cost against planning time", caption, (panel,))


def attitude_plot(episodes: Mapping[str, EpisodeBatch], shade: Mapping[str, Look]) -> Plot | None:
    """Base attitude against time: median and quartile band of each policy, all the others in grey behind."""
    if not episodes:
        return None
    bands = {policy: np.quantile(own.attitude, [0.25, 0.5, 0.75], axis=0) for policy, own in episodes.items()}
    top = 1.05 * max(float(band[2].max()) for band in bands.values()) or 1.0
    # A policy that spins the base must not push those that keep it onto zero.
    telling = [float(height) for band in bands.values() for height in (band[1].max(), band[1][-1])]
    logarithmic = is_wide(telling)
    end = max(float(own.time[-1]) for own in episodes.values())
    panels = []
    for number, (policy, own) in enumerate(episodes.items()):

        def draw(axes: Axes, policy: str = policy, own: EpisodeBatch = own) -> None:
            for other, band in bands.items():
                if other != policy:
                    axes.plot(episodes[other].time, band[1], color=INK, alpha=0.2, lw=0.9)
            low, middle, high = bands[policy]
            axes.fill_between(own.time, low, high, color=shade[policy].colour, alpha=0.3, lw=0)
            axes.plot(own.time, middle, color=shade[policy].colour, lw=2.2)
            axes.set(xlim=(0, end), ylim=(0, top), xlabel="time [s]", ylabel="base attitude [deg]")
            if logarithmic:
                wide_scale(axes.yaxis, telling)
            axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            axes.set_title(figure_name(policy))
            axes.grid()

        alt = f"{display_name(policy)}: median base attitude {bands[policy][1][-1]:.3g} deg at the end"
        panels.append(draw_panel(f"attitude-{number}", draw, alt, height=2.5))
    first = max(len(own) for own in episodes.values())
    caption = (
        f"Median and quartiles over the first {first} episodes of each policy, on one scale; the thin lines "
        "are the medians of the others. An episode that ended keeps its last value."
        + (" The scale is logarithmic above its first step." if logarithmic else "")
    )
    return Plot("attitude", "Base attitude against time", caption, tuple(panels))


def motion_plot(episodes: Mapping[str, EpisodeBatch]) -> Plot | None:
    """Rotation and translation of the base in one episode, the same one for every policy."""
    moving = {policy: own for policy, own in episodes.items() if any(map(np.any, own.base_displacement()))}
    if not moving:
        return None
    episode = representative_episode(moving)
    panels = []
    for number, (policy, own) in enumerate(moving.items()):
        row = min(episode, len(own) - 1)
        until = slice(0, int(own.length[row]) + 1)
        rotation, translation = (values[row] for values in own.base_displacement())

        def draw(
            figure: Figure,
            policy: str = policy,
            time: Array = own.time[until],
            rotation: Array = rotation[until],
            translation: Array = translation[until],
        ) -> None:
            above, below = figure.subplots(2, 1, sharex=True)
            for axes, values, label in (
                (above, rotation, "rotation [deg]"),
                (below, 1000 * translation, "translation [mm]"),
            ):
                for axis, (name, colour, dash) in enumerate(
                    (("x", BLUE, "-"), ("y", VERMILION, (0, (5, 1.5))), ("z", GREEN, (0, (1.5, 1.2))))
                ):
                    axes.plot(time, values[:, axis], color=colour, ls=dash, lw=1.9, label=name)
                axes.set_ylabel(label)
                axes.grid()
            above.set_title(figure_name(policy))
            above.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 0.98), borderaxespad=0)
            below.set_xlabel("time [s]")
            below.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            figure.align_ylabels()

        alt = (
            f"{display_name(policy)}: the base rotates by up to {own.attitude[row].max():.3g} deg and "
            f"moves by up to {1000 * np.linalg.norm(translation, axis=-1).max():.3g} mm"
        )
        panels.append(draw_panel(f"motion-{number}", draw, alt, height=3.4, whole=True))
    caption = (
        f"Rotation vector and translation of the base from where it started, in inertial axes, in episode "
        f"{episode}: the one whose peak attitude is the middle one over the policies' medians. "
        "Scales differ between policies."
    )
    return Plot("motion", "The base's motion", caption, tuple(panels))


def _from_zero(axes: Axes, values: Sequence[float]) -> None:
    """Start the horizontal axis at 0; logarithmic above the least value where they differ by much."""
    if is_wide(values):
        axes.set_xlim(left=0.0)
        wide_scale(axes.xaxis, values)
    else:
        axes.set_xlim(left=-0.03 * axes.get_xlim()[1])


def representative_episode(episodes: Mapping[str, EpisodeBatch]) -> int:
    """Episode with the middle peak attitude, taking for each episode the median over policies."""
    count = min(len(own) for own in episodes.values())
    peaks = np.median([own.attitude[:count].max(axis=1) for own in episodes.values()], axis=0)
    return int(np.argsort(peaks, kind="stable")[(count - 1) // 2])
