"""Tables of the page of shah2013."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from agents.planners.dual_arm.tracking import FINE
from reproduce.claims import CaseRecord
from reproduce.compare import figures_of, ratios
from reproduce.page.blocks import Table
from reproduce.shah2013.methods import METHODS, DualArmMethod
from reproduce.shah2013.runs import COARSE, PlannedCase, settings
from reproduce.shah2013.text import TEXT
from reproduce.shah2013.thresholds import SAME

RATIOS = (
    ("(b) / (a)", "local", ("zeta_zero",)),
    ("(c) / (a)", "ocp", ("zeta_zero",)),
    ("(c) / (b)", "ocp", ("local",)),
    ("(c) / best of (a), (b)", "ocp", ("zeta_zero", "local")),
    ("(c′) / (c)", "ocp_rest", ("ocp",)),
    ("(d) / (c)", "free", ("ocp",)),
)
COLORS = tuple(method.color for method in METHODS.values())


def energies(planned: PlannedCase) -> Table:
    """Energy, power and base rates of every method in the canonical case."""
    text = TEXT.fill("tables.energies", coarse=settings(COARSE), fine=settings(FINE))
    rows = [_energies(planned.record, method) for method in METHODS.values()]
    return Table(**text, rows=rows, colors=COLORS)


def _energies(record: CaseRecord, method: DualArmMethod) -> tuple[str, ...]:
    found, zero = figures_of(record, method.key), figures_of(record, "zeta_zero")
    if not found:
        return (method.title, *["-"] * 8)
    return (
        method.title,
        f"{found['energy']:.6f}",
        f"{found['energy'] / zero['energy']:.4f}" if zero else "-",
        f"{found['work']:.4f}",
        f"{1000 * found['peak_power']:.2f}",
        f"{found['base_rate']:.0e}",
        f"{found['tracked_base_rate']:.1e}",
        f"{found['tracked_base_rate_fine']:.1e}",
        f"{record['timing'][method.key]:.2f}",
    )


def plans_found(records: Sequence[CaseRecord]) -> Table:
    """Numbers of plans that each method found, and of failures by cause."""
    causes = sorted(
        {each["cause"] for record in records for each in record["methods"].values() if "cause" in each}
    )
    rows = []
    for key, method in METHODS.items():
        each = [record["methods"][key] for record in records]
        failed = Counter(found["cause"] for found in each if "cause" in found)
        seconds = float(np.median([record["timing"][key] for record in records]))
        found = str(len(each) - sum(failed.values()))
        rows.append((method.title, found, *(str(failed[cause]) for cause in causes), f"{seconds:.2f}"))
    text = TEXT.fill("tables.found")
    first, plans, planning = text["heads"]
    heads = (first, plans, *(cause.replace("_", " ") for cause in causes), planning)
    return Table(**{**text, "heads": heads}, rows=rows, colors=COLORS)


def energy_ratios(records: Sequence[CaseRecord]) -> Table:
    """Distribution of the ratios of the methods' energies."""
    rows = []
    for name, key, others in RATIOS:
        values = ratios(records, "energy", key, *others)
        if not values.size:
            rows.append((name, "0", *["-"] * 5))
            continue
        low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
        lower = 100 * float((values <= 1.0 + SAME).mean())
        figures = (f"{value:.3f}" for value in (middle, low, high, values.max()))
        rows.append((name, str(values.size), *figures, f"{lower:.0f}"))
    return Table(**TEXT.fill("tables.compared"), rows=rows)


def first_reasons(records: Sequence[CaseRecord]) -> Table:
    """One example of each cause for each method, in the planner's own words."""
    rows = []
    for key, method in METHODS.items():
        seen: dict[str, tuple[int, str]] = {}
        for record in records:
            found = record["methods"][key]
            if "cause" in found:
                seen.setdefault(found["cause"], (record["index"], found["reason"]))
        rows += [
            (method.title, cause.replace("_", " "), str(index), reason)
            for cause, (index, reason) in sorted(seen.items())
        ]
    return Table(**TEXT.fill("tables.causes", rows=rows), rows=rows, words=True)
