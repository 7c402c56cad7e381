"""Plots of the base's motion over time."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from space_envs.dynamics.rotations import Array
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, VERMILION, Look
from space_envs.evaluation.report.drawing.panel import INK, draw_panel
from space_envs.evaluation.report.drawing.ticks import is_wide, wide_scale
from space_envs.evaluation.report.plots.plot import Plot


def attitude_plot(episodes: Mapping[str, EpisodeBatch], looks: Mapping[str, Look]) -> Plot | None:
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
            axes.fill_between(own.time, low, high, color=looks[policy].color, alpha=0.3, lw=0)
            axes.plot(own.time, middle, color=looks[policy].color, lw=2.2)
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
                for axis, (name, color, dash) in enumerate(
                    (("x", BLUE, "-"), ("y", VERMILION, (0, (5, 1.5))), ("z", GREEN, (0, (1.5, 1.2))))
                ):
                    axes.plot(time, values[:, axis], color=color, ls=dash, lw=1.9, label=name)
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


def representative_episode(episodes: Mapping[str, EpisodeBatch]) -> int:
    """Episode with the middle peak attitude, taking for each episode the median over policies."""
    count = min(len(own) for own in episodes.values())
    peaks = np.median([own.attitude[:count].max(axis=1) for own in episodes.values()], axis=0)
    return int(np.argsort(peaks, kind="stable")[(count - 1) // 2])
