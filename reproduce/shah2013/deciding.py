"""What is read off the record of a case to decide a claim, and the sentences that show it.

Records are those of `reproduce.shah2013.runs.work_out`.
"""

from collections.abc import Callable

from reproduce import compare
from reproduce.compare import Record, figures_of

PAPER = ("zeta_zero", "local", "ocp")  # methods (a), (b), (c)
SAME = 1e-9  # relative; energies that differ by less are equal
MUCH = 0.9  # of another's energy or power, below which it counts as much lower
SUDDEN = 4.0  # times its mean, from which the fastest change of zeta counts as sudden
LATE = 0.75  # of the duration
ORDER = 1e-8  # rad/s, below which a base rate is of the paper's order, 1e-9 rad/s
ARRIVED = 1e-6  # m and m/s
HARDLY = 1e-6  # rad/s, of a simulated base
PRINTED = 18.0, 0.5  # s, when the paper has the sudden change, and how near to it counts as the same
NONE = "No plan."
LETTERS = {"zeta_zero": "(a)", "local": "(b)", "ocp": "(c)", "ocp_rest": "(c′)", "free": "(d)"}
REST = ("zeta_zero", "local", "ocp_rest", "free")  # methods that start from rest


def nonsingular(record: Record) -> bool:
    """Whether all three of the paper's methods found a plan."""
    return all(figures_of(record, key) for key in PAPER)


def ratio(record: Record, key: str, others: tuple[str, ...], name: str = "energy") -> float | None:
    """As in `reproduce.compare`, of energies if nothing else is said."""
    return compare.ratio(record, key, others, name)


def below(
    key: str, others: tuple[str, ...], most: float, name: str = "energy"
) -> Callable[[Record], bool | None]:
    """As in `reproduce.compare`, of energies if nothing else is said."""
    return compare.below(key, others, most, name)


def _base_rates(record: Record, name: str) -> list[float]:
    return [found[name] for key in PAPER if (found := figures_of(record, key)) and name in found]


def reactionless(record: Record) -> bool | None:
    """Whether the re-integrated base rates are of the paper's order."""
    rates = _base_rates(record, "base_rate")
    return all(rate <= ORDER for rate in rates) if rates else None


def reactionless_figures(record: Record) -> str:
    """Base rates of (a), (b), (c): re-integrated, and simulated at torque level."""
    if not _base_rates(record, "base_rate"):
        return NONE
    texts = []
    for name, how in (
        ("base_rate", "re-integrated"),
        ("tracked_base_rate", "simulated at torque level"),
        ("tracked_base_rate_fine", "simulated with small steps"),
    ):
        rates = _base_rates(record, name)
        if rates:
            texts.append(f"{', '.join(f'{rate:.1e}' for rate in rates)} rad/s {how}")
    return f"Largest for (a), (b), (c): {'; '.join(texts)}."


def tracked(record: Record) -> bool | None:
    """Whether the plans that start from rest hardly turn the base when they are simulated."""
    rates = [found["tracked_base_rate"] for key in REST if (found := figures_of(record, key))]
    return max(rates) <= HARDLY if rates else None


def tracked_figures(record: Record) -> str:
    """Base rates of the simulated plans that start from rest."""
    texts = [
        f"{LETTERS[key]} {found['tracked_base_rate']:.1e}"
        + (f" ({found['tracked_base_rate_fine']:.1e})" if "tracked_base_rate_fine" in found else "")
        for key in REST
        if (found := figures_of(record, key))
    ]
    return f"{', '.join(texts)} rad/s; in brackets with small steps." if texts else NONE


def arrives(record: Record) -> bool | None:
    """Whether (a), (b), (c) meet points and velocities."""
    found = [figures_of(record, key) for key in PAPER]
    found = [each for each in found if each]
    if not found:
        return None
    return all(max(each["end_position"], each["end_velocity"]) <= ARRIVED for each in found)


def arrival_figures(record: Record) -> str:
    """What they miss, and the turning that is left."""
    found = [each for key in PAPER if (each := figures_of(record, key))]
    if not found:
        return NONE
    position, speed, spin = (
        max(each[name] for each in found) for name in ("end_position", "end_velocity", "spin_left")
    )
    return (
        f"Points missed by at most {position:.0e} m and velocities by at most {speed:.0e} m/s. The "
        f"end-effectors still turn against the target, by up to {spin:.3f} rad/s."
    )


def sudden(record: Record) -> bool | None:
    """Whether zeta of (b) changes suddenly, late in the motion."""
    found = figures_of(record, "local")
    if not found:
        return None
    return found["zeta_jolt_ratio"] >= SUDDEN and found["zeta_jolt_time"] >= LATE * record["case"]["duration"]


def sudden_figures(record: Record) -> str:
    """When zeta of (b) changes fastest, and how fast."""
    found = figures_of(record, "local")
    if not found:
        return NONE
    return (
        f"ζ changes fastest at t = {found['zeta_jolt_time']:.1f} s of {record['case']['duration']:g} s, "
        f"{found['zeta_jolt_ratio']:.1f} times as fast as on average."
    )


def at_the_printed_time(record: Record) -> bool | None:
    """Whether arm 1's dependent velocity changes fastest when the paper says; asked of the canonical case."""
    found, (printed, near) = figures_of(record, "local"), PRINTED
    if not found or record["index"] >= 0:
        return None
    return abs(found["arm1_jolt_time"] - printed) <= near


def dependent_figures(record: Record) -> str:
    """When the dependent velocities of (b) change fastest, and how fast: each arm's, and both together."""
    found = figures_of(record, "local")
    if not found:
        return NONE
    arms = [
        f"{name} at t = {found[f'{arm}_jolt_time']:.2f} s ({found[f'{arm}_jolt']:.4f} rad/s²)"
        for arm, name in (("arm1", "that of arm 1 changes fastest"), ("arm2", "that of arm 2"))
    ]
    return (
        f"Of the dependent velocities {' and '.join(arms)}, of {record['case']['duration']:g} s; the norm of "
        f"both at {found['jolt_time']:.2f} s."
    )


def costs_later(record: Record) -> bool | None:
    """Where (b) costs more than (a): whether it does so only from the fastest change of zeta on."""
    more, found = ratio(record, "local", ("zeta_zero",)), figures_of(record, "local")
    if more is None or more <= 1.0 or not found:
        return None
    return found["lead"] <= 0.0


def lead_figures(record: Record) -> str:
    """Energy of (b) against (a), before the fastest change of zeta and at the end."""
    found, other = figures_of(record, "local"), figures_of(record, "zeta_zero")
    if not found or not other:
        return NONE
    behind = found["energy"] - other["energy"]
    return (
        f"2 s before ζ changes fastest, (b) has used {found['lead']:+.4f} J s against (a); at the end "
        f"{behind:+.4f} J s."
    )


def smooth_figures(record: Record) -> str:
    """Fastest change of the dependent velocities of (a), (b), (c)."""
    found = {key: figures_of(record, key) for key in PAPER}
    texts = [f"{each['jolt']:.4f}" if each else "-" for each in found.values()]
    return f"Fastest change of the dependent velocities of (a), (b), (c): {', '.join(texts)} rad/s²."


def pair(name: str, unit: str, scale: float, key: str, *others: str) -> Callable[[Record], str]:
    """As `reproduce.compare.comparison`."""

    def text(record: Record) -> str:
        return compare.comparison(record, key, others, name, LETTERS, lambda v: f"{scale * v:.5g}", unit)

    return text
