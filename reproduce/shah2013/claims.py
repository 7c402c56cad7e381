"""The claims of shah2013, a test for each, and the figures that show it; the words are in the page's text.

Records are those of `reproduce.shah2013.runs.work_out`. A test answers None where it cannot be asked.
"""

from functools import partial
from typing import Any

from reproduce.claims import CaseRecord, rules
from reproduce.compare import at_most, comparison, figures_of, ratio
from reproduce.shah2013.methods import METHODS
from reproduce.shah2013.text import TEXT
from reproduce.shah2013.thresholds import ARRIVED, HARDLY, LATE, MUCH, ORDER, PRINTED, SAME, SUDDEN

PAPER = ("zeta_zero", "local", "ocp")  # methods (a), (b), (c)
FROM_REST = ("zeta_zero", "local", "ocp_rest", "free")


def found_by(record: CaseRecord, keys: tuple[str, ...]) -> dict[str, Any]:
    """Figures of those methods that found a plan, by method."""
    return {key: found for key in keys if (found := figures_of(record, key))}


def nonsingular(record: CaseRecord) -> bool:
    """Whether all three of the paper's methods found a plan."""
    return len(found_by(record, PAPER)) == len(PAPER)


# The paper's claims


def independent(record: CaseRecord) -> bool | None:
    return figures_of(record, "zeta_zero") is not None


def arrival(record: CaseRecord) -> bool | None:
    found = found_by(record, PAPER).values()
    return (
        all(max(each["end_position"], each["end_velocity"]) <= ARRIVED for each in found) if found else None
    )


def reactionless(record: CaseRecord) -> bool | None:
    found = found_by(record, PAPER).values()
    return all(each["base_rate"] <= ORDER for each in found) if found else None


def zero_not_optimal(record: CaseRecord) -> bool | None:
    return at_most(record, "energy", "ocp", "zeta_zero", bound=1.0 - 1e-6)


def instant(record: CaseRecord) -> bool | None:
    return found["gradient"] < 1e-5 if (found := figures_of(record, "local")) else None


def local_energy(record: CaseRecord) -> bool | None:
    return None if (found := ratio(record, "energy", "local", "zeta_zero")) is None else found > 1.0 + SAME


def local_power(record: CaseRecord) -> bool | None:
    found = ratio(record, "peak_power", "local", "zeta_zero")
    return None if found is None else found > 1.0


def jump(record: CaseRecord) -> bool | None:
    if not (found := figures_of(record, "local")):
        return None
    return found["zeta_jolt_ratio"] >= SUDDEN and found["zeta_jolt_time"] >= LATE * record["case"]["duration"]


def jump_time(record: CaseRecord) -> bool | None:
    found, (printed, near) = figures_of(record, "local"), PRINTED
    if not found or record["index"] >= 0:
        return None
    return abs(found["arm1_jolt_time"] - printed) <= near


def jump_cost(record: CaseRecord) -> bool | None:
    more, found = ratio(record, "energy", "local", "zeta_zero"), figures_of(record, "local")
    if more is None or more <= 1.0 or not found:
        return None
    return found["lead"] <= 0.0


def not_total(record: CaseRecord) -> bool | None:
    return at_most(record, "energy", "ocp", "local", bound=1.0 - 1e-6)


def ocp_energy(record: CaseRecord) -> bool | None:
    return at_most(record, "energy", "ocp", "zeta_zero", "local", bound=MUCH)


def ocp_power(record: CaseRecord) -> bool | None:
    return at_most(record, "peak_power", "ocp", "zeta_zero", "local", bound=MUCH)


def smooth(record: CaseRecord) -> bool | None:
    return at_most(record, "jolt", "ocp", "local", bound=1.0)


def collocation(record: CaseRecord) -> bool | None:
    found = figures_of(record, "ocp")
    return found["path"] <= 1e-6 and found["base_rate"] <= 1e-8 if found else None


def minimum(record: CaseRecord) -> bool | None:
    return None if (found := ratio(record, "energy", "free", "ocp")) is None else found >= 1.0 - SAME


# Beyond the paper


def never_worse(record: CaseRecord) -> bool | None:
    return at_most(record, "energy", "ocp", "zeta_zero", "local", bound=1.0 + SAME)


def free(record: CaseRecord) -> bool | None:
    if not figures_of(record, "ocp"):
        return None
    return (found := ratio(record, "energy", "free", "ocp")) is not None and found <= 1.0 + SAME


def reaches(record: CaseRecord) -> bool | None:
    return None if nonsingular(record) else figures_of(record, "free") is not None


def rest(record: CaseRecord) -> bool | None:
    return at_most(record, "energy", "ocp_rest", "ocp", bound=1.001)


def torque(record: CaseRecord) -> bool | None:
    rates = [found["tracked_base_rate"] for found in found_by(record, FROM_REST).values()]
    return max(rates) <= HARDLY if rates else None


def sentence_figures(record: CaseRecord) -> dict[str, Any]:
    """Values of a record that the claims' sentences show."""
    by_method = {key: figures_of(record, key) for key in METHODS}
    letters = {key: f"({method.letter})" for key, method in METHODS.items()}
    paper, from_rest = found_by(record, PAPER), found_by(record, FROM_REST)

    energy = partial(comparison, record, "energy", names=letters, shown=lambda v: f"{v:.5g}", unit="J s")
    power = partial(
        comparison, record, "peak_power", names=letters, shown=lambda v: f"{1000 * v:.5g}", unit="mW"
    )
    return by_method | {
        "record": record,
        "duration": record["case"]["duration"],
        "paper": list(paper.values()),
        "rest": [{**found, "letter": letters[key]} for key, found in from_rest.items()],
        "fine": any("tracked_base_rate_fine" in found for found in from_rest.values()),
        "jolts": ", ".join(f"{each['jolt']:.4f}" if (each := by_method[key]) else "-" for key in PAPER),
        "energy": energy,
        "power": power,
    }


CLAIMS = rules(
    TEXT,
    "claims",
    (
        independent,
        arrival,
        reactionless,
        zero_not_optimal,
        instant,
        local_energy,
        local_power,
        jump,
        jump_time,
        jump_cost,
        not_total,
        ocp_energy,
        ocp_power,
        smooth,
        collocation,
        minimum,
    ),
    sentence_figures,
)
BEYOND = rules(TEXT, "beyond", (never_worse, free, reaches, rest, torque), sentence_figures)
