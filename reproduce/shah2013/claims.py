"""The claims of shah2013, each with the rule that decides it, and what goes beyond the paper.

Records are those of `reproduce.shah2013.runs.work_out`. One rule decides the canonical case and random ones.
"""

from collections.abc import Callable, Mapping
from typing import Any

from reproduce.claims import Rule
from reproduce.shah2013.measures import SAMPLES

Figures = Mapping[str, Any]
Record = Mapping[str, Any]

PAPER = ("zeta_zero", "local", "ocp")  # methods (a), (b), (c)
SAME = 1e-9  # relative; energies that differ by less are equal
MUCH = 0.9  # of another's energy or power, below which it counts as much lower
SUDDEN = 4.0  # times its mean, from which the fastest change of zeta counts as sudden
LATE = 0.75  # of the duration
ORDER = 1e-8  # rad/s, below which a base rate is of the paper's order, 1e-9 rad/s
ARRIVED = 1e-6  # m and m/s


def figures_of(record: Record, key: str) -> Figures | None:
    """Figures of a method; None where it found no plan."""
    found = record["methods"][key]
    return None if "cause" in found else found


def nonsingular(record: Record) -> bool:
    """Whether all three of the paper's methods found a plan."""
    return all(figures_of(record, key) for key in PAPER)


def ratio(record: Record, key: str, others: tuple[str, ...], name: str = "energy") -> float | None:
    """A figure of one method over the least of the others'; None where one of them found no plan."""
    found = [figures_of(record, each) for each in (key, *others)]
    if not all(found):
        return None
    values = [each[name] for each in found if each]
    return values[0] / min(values[1:])


def _below(
    key: str, others: tuple[str, ...], most: float, name: str = "energy"
) -> Callable[[Record], bool | None]:
    def test(record: Record) -> bool | None:
        found = ratio(record, key, others, name)
        return None if found is None else found <= most

    return test


def _base_rates(record: Record, name: str) -> list[float]:
    return [found[name] for key in PAPER if (found := figures_of(record, key))]


def _reactionless(record: Record) -> bool | None:
    rates = _base_rates(record, "base_rate")
    return all(rate <= ORDER for rate in rates) if rates else None


def _reactionless_figures(record: Record) -> str:
    texts = []
    for name, how in (
        ("base_rate", "re-integrated"),
        ("tracked_base_rate", "simulated at the suite's step of 20 ms with torques held for 0.1 s"),
        ("tracked_base_rate_fine", "simulated with step and control period of 5 ms"),
    ):
        rates = _base_rates(record, name)
        texts.append(f"{', '.join(f'{rate:.1e}' for rate in rates)} rad/s {how}")
    return f"Largest for (a), (b), (c): {'; '.join(texts)}."


def _arrives(record: Record) -> bool | None:
    found = [figures_of(record, key) for key in PAPER]
    found = [each for each in found if each]
    if not found:
        return None
    return all(max(each["end_position"], each["end_velocity"]) <= ARRIVED for each in found)


def _arrival_figures(record: Record) -> str:
    found = [each for key in PAPER if (each := figures_of(record, key))]
    position, speed, spin = (
        max(each[name] for each in found) for name in ("end_position", "end_velocity", "spin_left")
    )
    return (
        f"Points missed by at most {position:.0e} m and velocities by at most {speed:.0e} m/s. The "
        f"end-effectors still turn against the target, by up to {spin:.3f} rad/s."
    )


def _sudden(record: Record) -> bool | None:
    found = figures_of(record, "local")
    if not found:
        return None
    return found["zeta_jolt_ratio"] >= SUDDEN and found["zeta_jolt_time"] >= LATE * record["case"]["duration"]


def _sudden_figures(record: Record) -> str:
    found = figures_of(record, "local")
    if not found:
        return "Local optimisation found no plan."
    return (
        f"ζ changes fastest at t = {found['zeta_jolt_time']:.1f} s of {record['case']['duration']:g} s, "
        f"{found['zeta_jolt_ratio']:.1f} times as fast as on average; the dependent velocities at "
        f"t = {found['jolt_time']:.1f} s."
    )


def _costs_later(record: Record) -> bool | None:
    more, found = ratio(record, "local", ("zeta_zero",)), figures_of(record, "local")
    if more is None or more <= 1.0 or not found:
        return None
    return found["lead"] <= 0.0


def _lead_figures(record: Record) -> str:
    found, other = figures_of(record, "local"), figures_of(record, "zeta_zero")
    if not found or not other:
        return "One of the two found no plan."
    behind = found["energy"] - other["energy"]
    return (
        f"2 s before ζ changes fastest, (b) has used {found['lead']:+.4f} J s against (a); at the end "
        f"{behind:+.4f} J s."
    )


def _smooth_figures(record: Record) -> str:
    found = {key: figures_of(record, key) for key in PAPER}
    texts = [f"{each['jolt']:.4f}" if each else "-" for each in found.values()]
    return f"Fastest change of the dependent velocities of (a), (b), (c): {', '.join(texts)} rad/s²."


def _pair(name: str, unit: str, scale: float, key: str, *others: str) -> Callable[[Record], str]:
    """A sentence with a figure of one method and of others, and the change in percent."""

    def text(record: Record) -> str:
        values = {each: figures_of(record, each) for each in (key, *others)}
        letters = {"zeta_zero": "(a)", "local": "(b)", "ocp": "(c)", "ocp_rest": "(c′)", "free": "(d)"}
        shown = ", ".join(
            f"{letters[each]} {scale * found[name]:.5g}" if found else f"{letters[each]} none"
            for each, found in values.items()
        )
        change = ratio(record, key, others, name)
        last = "" if change is None else f" {100 * (change - 1.0):+.1f} %."
        return f"{shown} {unit}.{last}"

    return text


CLAIMS = (
    Rule(
        "independent",
        "III, eq. 7 to 9",
        "The degree of redundancy is five, so the four linear velocities of the end-effectors can be chosen "
        "independently; the angular ones follow from them.",
        "Method (a) finds a plan: the rows of the four velocities and of the reactionless constraint keep "
        "rank five all along the path, and the joints stay within their limits.",
        lambda record: (
            f"Least singular value of the five rows along the path of (a): {found['least_singular']:.3f}."
            if (found := figures_of(record, "zeta_zero"))
            else "No plan."
        ),
        lambda record: figures_of(record, "zeta_zero") is not None,
        "The count is over all drawn cases: paths through singularities are where it fails.",
    ),
    Rule(
        "arrival",
        "III, Fig. 2",
        "Both arms start from rest and intercept the grapple points with the desired linear velocities.",
        f"End-effectors of all of (a), (b), (c) that found a plan miss points by at most {ARRIVED:.0e} m and "
        f"velocities by at most {ARRIVED:.0e} m/s.",
        _arrival_figures,
        _arrives,
        "Angular velocities are not matched, as the paper chooses. The optimum of (c) starts with a jump of "
        "the joint rates; (c′) starts from rest.",
    ),
    Rule(
        "reactionless",
        "III and IV, Fig. 3(c), 4(c), 5(c)",
        "The angular velocity of the base is of the order 1e-9 rad/s, which ensures reactionless "
        "manipulation.",
        "Re-integrated between the plans' nodes, the base rate of all of (a), (b), (c) that found a plan "
        f"stays below {ORDER:.0e} rad/s.",
        _reactionless_figures,
        _reactionless,
        "Re-integrating a motion that was made from the constraint shows that it was put in and integrated "
        "accurately, not that a robot would rest. That is what the simulation with held torques on a "
        "floating base shows; (c) starts there with its jump of the rates.",
    ),
    Rule(
        "zero_not_optimal",
        "III",
        "Energy and power with ζ = 0 are not the optimal ones.",
        "Energy of (c) is below that of (a).",
        _pair("energy", "J s", 1.0, "ocp", "zeta_zero"),
        _below("ocp", ("zeta_zero",), 1.0 - 1e-6),
    ),
    Rule(
        "instant",
        "IV-A",
        "Local optimisation minimises the instantaneous energy at each time.",
        "The joint rates of (b) are orthogonal to the free direction in the metric of I_m: cosine below "
        "1e-5.",
        lambda record: (
            f"Largest cosine: (b) {found['gradient']:.0e}"
            + (f", (a) {other['gradient']:.2f}." if (other := figures_of(record, "zeta_zero")) else ".")
            if (found := figures_of(record, "local"))
            else "No plan."
        ),
        lambda record: found["gradient"] < 1e-5 if (found := figures_of(record, "local")) else None,
        "True by construction: (b) is solved in closed form.",
    ),
    Rule(
        "local_energy",
        "IV-A, Fig. 4(d)",
        "Local optimisation needs more energy than ζ = 0.",
        "Energy of (b) is above that of (a).",
        _pair("energy", "J s", 1.0, "local", "zeta_zero"),
        lambda record: None if (r := ratio(record, "local", ("zeta_zero",))) is None else r > 1.0 + SAME,
        "A property of the case, not of the method: mostly it is the other way round.",
    ),
    Rule(
        "local_power",
        "IV-A, Fig. 4(e)",
        "Local optimisation needs more power than ζ = 0.",
        "Peak power (sum of |torque × rate|) of (b) is above that of (a).",
        _pair("peak_power", "mW", 1000.0, "local", "zeta_zero"),
        lambda record: (
            None if (r := ratio(record, "local", ("zeta_zero",), "peak_power")) is None else r > 1.0
        ),
    ),
    Rule(
        "jump",
        "IV-A, Fig. 4(a)",
        "At t = 18 s there is a sudden change in the optimal ζ.",
        f"ζ of (b) changes at its fastest at least {SUDDEN:g} times as fast as on average, and does so in "
        "the last quarter of the motion.",
        _sudden_figures,
        _sudden,
        "The duration of the paper's motion is lost, so the time itself cannot be compared.",
    ),
    Rule(
        "jump_cost",
        "IV-A",
        "The sudden change makes the dependent velocities change, which needs the additional energy.",
        "Asked where (b) needs more than (a): 2 s before ζ changes fastest, (b) has not yet used more than "
        "(a).",
        _lead_figures,
        _costs_later,
    ),
    Rule(
        "not_total",
        "IV-A",
        "Local optimisation does not minimise the total energy.",
        "Energy of (c) is below that of (b).",
        _pair("energy", "J s", 1.0, "ocp", "local"),
        _below("ocp", ("local",), 1.0 - 1e-6),
    ),
    Rule(
        "ocp_energy",
        "IV-B, Fig. 5(d), V",
        "Optimal control needs much less energy than both others.",
        f"Energy of (c) is below {MUCH:g} times the lower one of (a) and (b).",
        _pair("energy", "J s", 1.0, "ocp", "zeta_zero", "local"),
        _below("ocp", ("zeta_zero", "local"), MUCH),
        "The change is against the better of the two.",
    ),
    Rule(
        "ocp_power",
        "IV-B, Fig. 5(e), V",
        "Optimal control needs much less power than both others.",
        f"Peak power of (c) is below {MUCH:g} times the lower one of (a) and (b).",
        _pair("peak_power", "mW", 1000.0, "ocp", "zeta_zero", "local"),
        _below("ocp", ("zeta_zero", "local"), MUCH, "peak_power"),
        "Power is not what is minimised.",
    ),
    Rule(
        "smooth",
        "IV-B, Fig. 5(a), 5(b)",
        "Optimal control gives a smooth transition of the dependent angular velocities.",
        "The dependent velocities of (c) never change as fast as those of (b) do.",
        _smooth_figures,
        _below("ocp", ("local",), 1.0, "jolt"),
    ),
    Rule(
        "collocation",
        "IV-B",
        "The polynomial satisfies the equations and the path constraints at the collocation points.",
        "Between the points too: path of (c) off by at most 1e-6 m, base rate at most 1e-8 rad/s.",
        lambda record: (
            f"Path off by {found['path']:.0e} m, base rate {found['base_rate']:.0e} rad/s, at {SAMPLES} "
            "times."
            if (found := figures_of(record, "ocp"))
            else "No plan."
        ),
        lambda record: (
            found["path"] <= 1e-6 and found["base_rate"] <= 1e-8
            if (found := figures_of(record, "ocp"))
            else None
        ),
        "After collocation our plans are integrated again along the paths, so that they hold in between.",
    ),
    Rule(
        "global",
        "IV-B",
        "Optimal control provides global optimisation.",
        "Not counted: a local method from several starts gives no bound from below.",
        lambda record: "Several starts, the motions of (a) and (b) among them; the best is taken.",
    ),
    Rule(
        "minimum",
        "V",
        "The method ensures reactionless manipulation with minimum energy consumption.",
        "No reactionless motion between the same ends with less energy is known: (d) does not go below (c).",
        _pair("energy", "J s", 1.0, "free", "ocp"),
        lambda record: None if (r := ratio(record, "free", ("ocp",))) is None else r >= 1.0 - SAME,
        "Minimum holds along the given end-effector paths; the paths themselves are not optimal.",
    ),
)

BEYOND = (
    Rule(
        "never_worse",
        "(c) against (a), (b)",
        "From several starts, optimal control is never worse than either of the others.",
        "Cases in which all of (a), (b), (c) found a plan: energy of (c) is at most the lower one of the "
        "others.",
        _pair("energy", "J s", 1.0, "ocp", "zeta_zero", "local"),
        _below("ocp", ("zeta_zero", "local"), 1.0 + SAME),
    ),
    Rule(
        "free",
        "(d) against (c)",
        "With free paths the same capture costs less.",
        "Energy of (d) is at most that of (c); where (c) found a plan and (d) none, it counts as not so.",
        _pair("energy", "J s", 1.0, "free", "ocp"),
        lambda record: (
            None
            if not figures_of(record, "ocp")
            else (r := ratio(record, "free", ("ocp",))) is not None and r <= 1.0 + SAME
        ),
        "Method (d) starts from rest and keeps the limits of the drives, which (c) does not.",
    ),
    Rule(
        "reaches",
        "(d)",
        "Free paths go round singularities.",
        "Method (d) finds a plan; over all drawn cases.",
        lambda record: "A plan." if figures_of(record, "free") else record["methods"]["free"]["reason"],
        lambda record: figures_of(record, "free") is not None,
    ),
    Rule(
        "rest",
        "(c′) against (c)",
        "Starting from rest costs next to nothing.",
        "Energy of (c′) is at most 1.001 times that of (c).",
        _pair("energy", "J s", 1.0, "ocp_rest", "ocp"),
        _below("ocp_rest", ("ocp",), 1.001),
    ),
    Rule(
        "torque",
        "(c′) and (d), simulated",
        "Tracked at torque level on a floating base, the plans that start from rest do not turn the "
        "satellite.",
        "Largest base rate at the suite's step: at most 1e-6 rad/s, for those of (c′) and (d) that found a "
        "plan.",
        lambda record: (
            "; ".join(
                f"{letter} {found['tracked_base_rate']:.1e} rad/s, fine {found['tracked_base_rate_fine']:.1e}"
                for letter, key in (("(c′)", "ocp_rest"), ("(d)", "free"))
                if (found := figures_of(record, key))
            )
            + "."
        ),
        lambda record: (
            max(rates) <= 1e-6
            if (
                rates := [
                    found["tracked_base_rate"]
                    for key in ("ocp_rest", "free")
                    if (found := figures_of(record, key))
                ]
            )
            else None
        ),
    ),
)
