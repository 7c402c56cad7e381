"""Figure of the planners compared over the goals."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from reproduce.claims import CaseRecord
from reproduce.compare import figures_of, ratios
from reproduce.page.drawing import DASHES, shares
from reproduce.page.figures import Figure, figure
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.page.text import TEXT
from space_envs.evaluation.report.drawing.panel import INK

LETTERS = {key: "abcdefghi"[number] for number, key in enumerate(METHODS)}  # on narrow panels
LEAST_ATTITUDE = 1e-5  # deg; smaller ones are drawn there


def compared(records: Sequence[CaseRecord]) -> Figure:
    """Costs against optimal control, end attitudes, and planning times over the goals."""
    names = "; ".join(f"{LETTERS[key]} {method.name}" for key, method in METHODS.items())
    medians = "; ".join(
        f"{method.name} {np.median(values):.2f}"
        for key, method in METHODS.items()
        if (values := ratios(records, "cost", key, "ocp")).size
    )
    draws = (
        lambda axes: _draw_ratios(axes, records),
        lambda axes: _draw_attitudes(axes, records),
        lambda axes: _draw_times(axes, records),
    )
    return figure("compared", TEXT.fill("figures.compared", names=names, medians=medians), draws, height=3.3)


def _draw_ratios(axes: Axes, records: Sequence[CaseRecord]) -> None:
    for key, method in METHODS.items():
        values = ratios(records, "cost", key, "ocp")
        if key != "ocp" and values.size:
            axes.step(np.sort(values), shares(values), color=method.color, lw=1.9, label=LETTERS[key])
    axes.axvline(1.0, color=INK, lw=0.8, ls=DASHES[1])
    axes.set(xlabel="eq. 20 over that of optimal control", ylabel="goals up to here [%]", xscale="log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(
        FuncFormatter(lambda value, _: f"{value:g}" if value in (0.5, 2.0, 3.0, 5.0) else "")
    )
    axes.legend(ncols=2, fontsize=8, loc="lower right")
    axes.grid()


def _draw_attitudes(axes: Axes, records: Sequence[CaseRecord]) -> None:
    def attitude(record: CaseRecord, key: str) -> float:
        return max(np.rad2deg(record["methods"][key]["end_attitude"]), LEAST_ATTITUDE)

    _strips(axes, records, attitude)
    axes.set(xlabel="end attitude [deg]", xscale="log")


def _draw_times(axes: Axes, records: Sequence[CaseRecord]) -> None:
    _strips(axes, records, lambda record, key: 1000 * record["timing"][key])
    axes.set(xlabel="planning [ms]", xscale="log")


def _strips(axes: Axes, records: Sequence[CaseRecord], value: Callable[[CaseRecord, str], float]) -> None:
    """Draw a row of dots for each method, one for each record in which it has a plan."""
    shift = np.random.default_rng(0).uniform(-0.22, 0.22, len(records))
    for number, (key, method) in enumerate(METHODS.items()):
        rows = [row for row, record in enumerate(records) if figures_of(record, key)]
        if not rows:
            continue
        points = np.array([(value(records[row], key), shift[row]) for row in rows])
        axes.plot(points[:, 0], number + points[:, 1], "o", color=method.color, ms=3, alpha=0.55, mew=0)
        middle = float(np.median(points[:, 0]))
        axes.plot([middle, middle], [number - 0.34, number + 0.34], color=INK, lw=1.8)
    axes.set_yticks(range(len(METHODS)), [LETTERS[key] for key in METHODS])
    axes.set_ylim(len(METHODS) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="x")
