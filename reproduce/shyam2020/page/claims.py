"""The claims of shyam2020, a test for each, and the figures that show it; the words are in the page's text.

Records are those of `reproduce.shyam2020.runs.work_out`. A test answers None where it cannot be asked.
"""

from functools import partial
from math import degrees, inf
from typing import Any

import numpy as np

from reproduce.claims import CaseRecord, rules
from reproduce.compare import at_most, comparison, figures_of, percent
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.page.text import TEXT
from reproduce.shyam2020.page.thresholds import (
    BEST_TENTH,
    COMPACT,
    ENVELOPE,
    FAST,
    KEPT,
    MET,
    MUCH,
    NEAR,
    NEVER,
    OFTEN,
    PERIOD,
    SAME,
)

ATTITUDE_UNCONSTRAINED = ("minimum_jerk", "mpc", "promp_mean", "promp", "ocp", "promp_optimal")


def least_known(record: CaseRecord) -> float:
    """Least eq. 20, m^2/s, of the methods without an attitude constraint; inf without any."""
    found = (figures_of(record, key) for key in ATTITUDE_UNCONSTRAINED)
    return min((each["cost"] for each in found if each), default=inf)


def meets(record: CaseRecord, *keys: str) -> bool:
    """Whether the methods' end-effectors are at the goal at the end; a method without a plan is not."""
    found = [figures_of(record, key) for key in keys]
    return all(
        each is not None and each["position_error"] <= MET[0] and each["rotation_error"] <= MET[1]
        for each in found
    )


def sampling_gain(record: CaseRecord, count: int) -> float | None:
    """Least cost of the first `count` samples over the cost of the conditional mean."""
    samples, mean = record["samples"], figures_of(record, "promp_mean")
    return min(samples["cost"][:count]) / mean["cost"] if samples and mean else None


def attitude_spread(record: CaseRecord) -> float | None:
    """Least end attitude of the samples over that of the conditional mean."""
    samples, mean = record["samples"], figures_of(record, "promp_mean")
    return min(samples["end_attitude"]) / mean["end_attitude"] if samples and mean else None


def captured(found: dict[str, Any]) -> bool:
    """Whether errors at the goal are within the suite's envelope of a capture."""
    return found["position_error"] <= ENVELOPE[0] and found["rotation_error"] <= ENVELOPE[1]


def faster(record: CaseRecord, key: str, other: str, share: float) -> bool | None:
    """Whether a method plans in at most a share of another's time."""
    if not (figures_of(record, key) and figures_of(record, other)):
        return None
    return record["timing"][key] <= share * record["timing"][other]


def cheapest_attitude(samples: dict[str, Any]) -> float:
    """End attitude, rad, of the sample of least cost."""
    return samples["end_attitude"][int(np.argmin(samples["cost"]))]


# The paper's claims


def compact(record: CaseRecord) -> bool | None:
    return found["error"] <= COMPACT if (found := record["encoding"]) else None


def unseen(record: CaseRecord) -> bool | None:
    return meets(record, "promp_mean", "promp")


def literal(record: CaseRecord) -> bool | None:
    return captured(record["literal"])


def via_point(record: CaseRecord) -> bool | None:
    return found["via_point"] <= 1e-6 if (found := record["via_point"]) else None


def several(record: CaseRecord) -> bool | None:
    return captured(samples) if (samples := record["samples"]) else None


def cost_measures(record: CaseRecord) -> bool | None:
    if not (samples := record["samples"]):
        return None
    attitude = np.array(samples["end_attitude"])
    return bool((attitude < cheapest_attitude(samples)).mean() < BEST_TENTH)


def sampling_20(record: CaseRecord) -> bool | None:
    return None if (gain := sampling_gain(record, 20)) is None else gain <= MUCH


def sampling_100(record: CaseRecord) -> bool | None:
    return at_most(record, "cost", "promp", "promp_mean", bound=MUCH)


def against_minimum_jerk(record: CaseRecord) -> bool | None:
    return at_most(record, "cost", "promp", "minimum_jerk", bound=1.0)


def against_demonstrator(record: CaseRecord) -> bool | None:
    return at_most(record, "cost", "promp", "mpc", bound=1.0)


def minimum(record: CaseRecord) -> bool | None:
    return at_most(record, "cost", "promp", "ocp", bound=NEAR)


def attitude(record: CaseRecord) -> bool | None:
    return at_most(record, "end_attitude", "promp", "promp_mean", bound=MUCH)


def attitude_any(record: CaseRecord) -> bool | None:
    return None if (spread := attitude_spread(record)) is None else spread <= MUCH


def attitude_optimum(record: CaseRecord) -> bool | None:
    if not (found := figures_of(record, "promp")) or not figures_of(record, "ocp_kept"):
        return None
    return found["end_attitude"] <= KEPT


def efficient(record: CaseRecord) -> bool | None:
    return faster(record, "promp", "ocp", FAST)


def expensive(record: CaseRecord) -> bool | None:
    return record["timing"]["promp_optimal"] > PERIOD if figures_of(record, "promp_optimal") else None


def local_minima(record: CaseRecord) -> bool | None:
    if not (best := figures_of(record, "ocp")):
        return None
    return "cause" in record["once"] or record["once"]["cost"] > (1.0 + OFTEN) * best["cost"]


def obstacle_free(record: CaseRecord) -> bool | None:
    return record["sphere"]["usable"] > 0 if record["sphere"] else None


def special_cases(record: CaseRecord) -> bool | None:
    found = figures_of(record, "promp_reactionless")
    return not (found and found["peak_attitude"] <= NEVER and meets(record, "promp_reactionless"))


def failure(record: CaseRecord) -> bool | None:
    return record["locked"]["still"] == record["locked"]["of"]


# Beyond the paper


def reference(record: CaseRecord) -> bool | None:
    best = figures_of(record, "ocp")
    return None if not best else best["cost"] <= (1.0 + SAME) * least_known(record)


def weights_hold_it(record: CaseRecord) -> bool | None:
    return at_most(record, "cost", "promp_optimal", "ocp", bound=1.15)


def kept(record: CaseRecord) -> bool | None:
    if not figures_of(record, "ocp_kept"):
        return None
    found = figures_of(record, "promp_optimal_kept")
    return found is not None and found["end_attitude"] <= KEPT and meets(record, "promp_optimal_kept")


def kept_costs_less(record: CaseRecord) -> bool | None:
    return at_most(record, "cost", "promp_optimal_kept", "promp", bound=1.0)


def optimum_faster(record: CaseRecord) -> bool | None:
    return faster(record, "promp_optimal", "promp", 1.0)


def kept_real_time(record: CaseRecord) -> bool | None:
    found = figures_of(record, "promp_optimal_kept")
    return record["timing"]["promp_optimal_kept"] <= PERIOD if found else None


def avoids(record: CaseRecord) -> bool | None:
    if not record["sphere"]:
        return None
    optimal = record["sphere"]["optimal"]
    return "cause" not in optimal and optimal["gap"] > -1e-4


def sentence_figures(record: CaseRecord) -> dict[str, Any]:
    """Values of a record that the claims' sentences show."""
    by_method = {key: figures_of(record, key) for key in METHODS}
    names = {key: method.name for key, method in METHODS.items()}
    samples, mean = record["samples"], by_method["promp_mean"]

    costs = partial(comparison, record, "cost", names=names, shown=lambda v: f"{1e4 * v:.3f}", unit="cm²/s")
    attitudes = partial(
        comparison, record, "end_attitude", names=names, shown=lambda v: f"{degrees(v):.3f}", unit="deg"
    )

    def times(*keys: str) -> str:
        return ", ".join(f"{names[key]} {1000 * record['timing'][key]:.0f} ms" for key in keys) + "."

    figures = by_method | {
        "record": record,
        "samples": samples,
        "spread": attitude_spread(record),
        "sphere": TEXT.fill("sentences.sphere", sphere=record["sphere"]),
        "costs": costs,
        "attitudes": attitudes,
        "times": times,
        "percent": percent,
    }
    if samples:
        cheapest = cheapest_attitude(samples)
        figures["cheapest"] = cheapest
        figures["with_less"] = int((np.array(samples["end_attitude"]) < cheapest).sum())
    if samples and mean:
        cost = 1e4 * np.array(samples["cost"])
        for count in (20, 100):
            figures[f"change_{count}"] = 100 * (min(cost[:count]) / (1e4 * mean["cost"]) - 1.0)
    return figures


CLAIMS = rules(
    TEXT,
    "claims",
    (
        compact,
        unseen,
        literal,
        via_point,
        several,
        cost_measures,
        sampling_20,
        sampling_100,
        against_minimum_jerk,
        against_demonstrator,
        minimum,
        attitude,
        attitude_any,
        attitude_optimum,
        efficient,
        expensive,
        local_minima,
        obstacle_free,
        special_cases,
        failure,
    ),
    sentence_figures,
)
BEYOND = rules(
    TEXT,
    "beyond",
    (reference, weights_hold_it, kept, kept_costs_less, optimum_faster, kept_real_time, avoids),
    sentence_figures,
)
