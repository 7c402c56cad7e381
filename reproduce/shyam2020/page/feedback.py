"""Control from the learned distribution (sec. VII) on the page: joint motions, and errors at the end."""

import numpy as np
from matplotlib.axes import Axes

from reproduce.compare import short
from reproduce.page.blocks import Table
from reproduce.page.figures import Draw, Figure, figure
from reproduce.shyam2020.feedback import EPISODES, FeedbackResult, spread_ratio
from reproduce.shyam2020.page.text import TEXT
from space_envs.evaluation.report.drawing.look import BLUE, SKY, VERMILION
from space_envs.evaluation.report.drawing.panel import INK

LINES = 12  # episodes that are drawn
BAND = 2.0  # standard deviations on either side of the mean
JOINTS = (1, 3)  # counted from 0, in the figure


def feedback_figure(found: FeedbackResult) -> Figure:
    """Joint angles under the law against the distribution, and the spreads over time."""
    text = TEXT.fill(
        "figures.feedback",
        joints=[number + 1 for number in JOINTS],
        inside=[_inside(found, number) for number in JOINTS],
        band=BAND,
        ratio=spread_ratio(found),
    )
    draws = (*(_joint(found, number) for number in JOINTS), lambda axes: _draw_spreads(axes, found))
    return figure("feedback", text, draws, height=3.0)


def _inside(found: FeedbackResult, number: int) -> float:
    """Share of the time that a joint spends within `BAND` of the distribution, and a thousandth rad."""
    deviation = np.abs(found.drawn.joints[:, :, number] - found.mean[:, number])
    return float((deviation <= BAND * found.spread[:, number] + 1e-3).mean())


def _joint(found: FeedbackResult, number: int) -> Draw:
    """Function that draws the angles of a joint over time."""

    def draw(axes: Axes) -> None:
        time = found.drawn.time
        mean, spread = np.rad2deg(found.mean[:, number]), np.rad2deg(found.spread[:, number])
        low, high = mean - BAND * spread, mean + BAND * spread
        axes.fill_between(time, low, high, color=SKY, alpha=0.35, lw=0, label=f"ProMP, ±{BAND:g} σ")
        for row in range(min(LINES, len(found.drawn.joints))):
            line = np.rad2deg(found.drawn.joints[row, :, number])
            axes.plot(time, line, color=BLUE, lw=0.8, label="drawn, in MuJoCo" if row == 0 else None)
        expected = np.rad2deg(found.expected.joints[0, :, number])
        axes.plot(time, expected, color=VERMILION, lw=1.8, label="expected, in MuJoCo")
        axes.set(xlabel="time [s]", ylabel=f"joint {number + 1} [deg]")
        axes.legend(fontsize=8)
        axes.grid()

    return draw


def _draw_spreads(axes: Axes, found: FeedbackResult) -> None:
    for values, color, style, name in (
        (found.spread, INK, "--", "ProMP"),
        (found.drawn.joints.std(axis=0), BLUE, "-", f"{EPISODES} episodes in MuJoCo"),
    ):
        overall = np.rad2deg(np.sqrt((values**2).mean(axis=1)))
        axes.plot(found.drawn.time, overall, color=color, ls=style, lw=1.8, label=name)
    axes.set(xlabel="time [s]", ylabel="spread of the joints [deg]")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    axes.grid()


def feedback_table(found: FeedbackResult) -> Table:
    """Errors of the law at the end of the motion, and of tracking a plan."""
    rows = []
    for name, episodes in (
        (f"law, drawn ({len(found.drawn.cost)} episodes)", found.drawn),
        ("law, expected accelerations", found.expected),
        ("conditional mean, tracked", found.followed),
        ("best of 100, tracked", found.best),
    ):
        values = (1e4 * episodes.cost, np.rad2deg(episodes.attitude), 1e3 * episodes.position_error)
        rows.append(
            (
                name,
                *(short(float(np.median(value))) for value in values),
                short(1e3 * float(episodes.position_error.max())),
                f"{np.rad2deg(np.median(episodes.rotation_error)):.2f}",
            )
        )
    return Table(**TEXT.fill("tables.feedback"), rows=rows)
