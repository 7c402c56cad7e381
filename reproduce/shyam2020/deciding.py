"""What is read off the record of a goal to decide a claim, and the sentences that show it.

Records are those of `reproduce.shyam2020.runs.work_out`.
"""

from collections.abc import Callable
from math import degrees, inf, radians

import numpy as np

from reproduce.compare import Record, comparison, figures_of, percent
from reproduce.shyam2020.methods import METHODS

MUCH = 0.9  # of another's cost or attitude, below which it counts as lower
NEAR = 1.05  # of the least cost known, up to which a cost counts as the minimum
SAME = 2e-3  # relative; costs that differ by less are equal: one is read off splines, one off samples
MET = (1e-3, radians(0.05))  # m and rad, of an end-effector that meets its goal
ENVELOPE = (0.05, radians(5.0))  # m and rad, within which the suite's target is captured
KEPT = radians(0.05)  # rad, of an attitude that is kept
FAST = 0.1  # of optimal control's planning time
PERIOD = 0.1  # s, a control period of the suite
COMPACT = 0.01  # of the largest joint displacement, error of a motion in the ProMP's weights
OFTEN = 0.01  # relative, by which a single start costs more if it is stuck
BEST_TENTH = 0.1
NONE = "No plan."
NO_GOAL = "No joint goal."


def least_known(record: Record) -> float:
    """The least eq. 20 of any method that leaves the attitude free, m^2/s; inf where none has a plan."""
    keys = ("minimum_jerk", "mpc", "promp_mean", "promp", "ocp", "promp_optimal")
    return min((found["cost"] for key in keys if (found := figures_of(record, key))), default=inf)


def meets(record: Record, *keys: str) -> bool | None:
    """Whether the methods' end-effectors are at the goal at the end; a method without a plan is not."""
    found = [figures_of(record, key) for key in keys]
    return all(
        each is not None and each["position_error"] <= MET[0] and each["rotation_error"] <= MET[1]
        for each in found
    )


def meets_figures(*keys: str) -> Callable[[Record], str]:
    """What the end-effectors miss."""

    def text(record: Record) -> str:
        parts = []
        for key in keys:
            found = figures_of(record, key)
            parts.append(
                f"{METHODS[key].name}: {1000 * found['position_error']:.2f} mm and "
                f"{degrees(found['rotation_error']):.4f} deg"
                if found
                else f"{METHODS[key].name}: no plan"
            )
        return "; ".join(parts) + "."

    return text


def pair(name: str, key: str, *others: str) -> Callable[[Record], str]:
    """As `reproduce.compare.comparison`."""
    scale, unit = {"cost": (1e4, "cm²/s"), "end_attitude": (degrees(1.0), "deg")}[name]
    names = {each: METHODS[each].name for each in (key, *others)}

    def text(record: Record) -> str:
        return comparison(record, key, others, name, names, lambda v: f"{scale * v:.3f}", unit)

    return text


def sampling_gain(record: Record, count: int) -> float | None:
    """Least cost of the first `count` samples over the cost of the conditional mean."""
    samples, mean = record["samples"], figures_of(record, "promp_mean")
    return min(samples["cost"][:count]) / mean["cost"] if samples and mean else None


def sampling_figures(record: Record) -> str:
    """Costs of the samples against the mean's."""
    samples, mean = record["samples"], figures_of(record, "promp_mean")
    if not samples or not mean:
        return NO_GOAL
    cost = 1e4 * np.array(samples["cost"])
    changes = [100 * (min(cost[:count]) / (1e4 * mean["cost"]) - 1.0) for count in (20, 100)]
    return (
        f"Samples cost {cost.min():.1f} to {cost.max():.1f} cm²/s, their mean "
        f"motion {1e4 * mean['cost']:.1f}: best of 20 {changes[0]:+.0f} %, best of 100 {changes[1]:+.0f} %."
    )


def samples_reach(record: Record) -> bool | None:
    """Whether all samples end in the capture envelope."""
    samples = record["samples"]
    return samples["missed"] <= ENVELOPE[0] and samples["turned_off"] <= ENVELOPE[1] if samples else None


def samples_reach_figures(record: Record) -> str:
    """What the samples miss at most."""
    samples = record["samples"]
    if not samples:
        return NO_GOAL
    return (
        f"Samples miss the inertial goal by up to {1000 * samples['missed']:.1f} mm and "
        f"{degrees(samples['turned_off']):.2f} deg."
    )


def least_disturbing(record: Record) -> bool | None:
    """Whether the sample of least cost is among the tenth that turn the base least at the end."""
    samples = record["samples"]
    if not samples:
        return None
    attitude = np.array(samples["end_attitude"])
    chosen = attitude[int(np.argmin(samples["cost"]))]
    return bool((attitude < chosen).mean() < BEST_TENTH)


def least_disturbing_figures(record: Record) -> str:
    """End attitudes of the samples, and where the cheapest one stands."""
    samples = record["samples"]
    if not samples:
        return NO_GOAL
    attitude = np.rad2deg(samples["end_attitude"])
    chosen = attitude[int(np.argmin(samples["cost"]))]
    return (
        f"End attitude of the samples {attitude.min():.2f} to {attitude.max():.2f} deg, of the cheapest "
        f"{chosen:.2f} deg: {int((attitude < chosen).sum())} of {attitude.size} end with less. Rank "
        f"correlation of cost and end attitude {samples['rank_correlation']:+.2f}."
    )


def attitude_spread(record: Record) -> float | None:
    """Least end attitude of the samples over that of the conditional mean."""
    samples, mean = record["samples"], figures_of(record, "promp_mean")
    return min(samples["end_attitude"]) / mean["end_attitude"] if samples and mean else None


def attitude_spread_figures(record: Record) -> str:
    """How little even the best sample's end attitude differs."""
    found = attitude_spread(record)
    if found is None:
        return NO_GOAL
    return (
        f"Of the samples, the one that ends with the least attitude has {percent(100 * (found - 1.0))} % "
        "against the mean motion."
    )


def faster(key: str, other: str, share: float) -> Callable[[Record], bool | None]:
    """Test whether a method plans in at most a share of another's time."""

    def test(record: Record) -> bool | None:
        if not (figures_of(record, key) and figures_of(record, other)):
            return None
        return record["timing"][key] <= share * record["timing"][other]

    return test


def times(*keys: str) -> Callable[[Record], str]:
    """Planning times in words."""

    def text(record: Record) -> str:
        return ", ".join(f"{METHODS[key].name} {1000 * record['timing'][key]:.0f} ms" for key in keys) + "."

    return text


def stuck(record: Record) -> bool | None:
    """Whether optimal control from one start finds nothing, or costs more than from several."""
    best = figures_of(record, "ocp")
    if not best:
        return None
    return "cause" in record["once"] or record["once"]["cost"] > (1.0 + OFTEN) * best["cost"]


def stuck_figures(record: Record) -> str:
    """One start against several."""
    best, once = figures_of(record, "ocp"), record["once"]
    if not best:
        return NONE
    if "cause" in once:
        return f"From one start no motion: {once['reason']}."
    change = 100 * (once["cost"] / best["cost"] - 1.0)
    return f"From one start {1e4 * once['cost']:.3f} cm²/s, {percent(change)} % against several."


def dodges(record: Record) -> bool | None:
    """Whether a sample within the limits is clear of the ball."""
    return record["ball"]["usable"] > 0 if record["ball"] else None


def ball_text(record: Record) -> str:
    """How many samples are clear of the ball, and what the weight-space planner finds."""
    ball = record["ball"]
    if not ball:
        return "No place for a ball that leaves start and goal clear."
    optimal = ball["optimal"]
    found = (
        f"none ({optimal['reason']})"
        if "cause" in optimal
        else f"one of {1e4 * optimal['cost']:.2f} cm²/s, clear by {1000 * optimal['gap']:.1f} mm"
    )
    cheapest = "" if ball["cost"] is None else f", the cheapest of {1e4 * ball['cost']:.2f} cm²/s"
    return f"{ball['usable']} of the samples are clear of it{cheapest}; planned in the weights: {found}."


def refined(record: Record) -> bool | None:
    """Whether the weight-space planner finds a motion that is clear of the ball, to a tenth of a mm."""
    if not record["ball"]:
        return None
    optimal = record["ball"]["optimal"]
    return "cause" not in optimal and optimal["gap"] > -1e-4


def locked_text(record: Record) -> str:
    """With how many joints locked a motion is found."""
    return (
        f"A minimum-jerk motion to the goal is found with {record['locked']['still']} of the "
        f"{record['locked']['of']} joints locked, one at a time, by a search from "
        f"{record['locked']['starts']} starts."
    )


def kept(record: Record) -> bool | None:
    """Whether the weight-space planner ends at the goal with the attitude kept, if that can be."""
    if not figures_of(record, "ocp_kept"):
        return None
    found = figures_of(record, "promp_optimal_kept")
    return found is not None and found["end_attitude"] <= KEPT and bool(meets(record, "promp_optimal_kept"))


def never_beaten(record: Record) -> bool | None:
    """Whether no planner within the limits has a lower cost than optimal control."""
    best = figures_of(record, "ocp")
    return None if not best else best["cost"] <= (1.0 + SAME) * least_known(record)
