"""The page of shah2013: its words, tables and files, around the figures and claims."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from math import degrees
from typing import Any

import numpy as np

from reproduce.cases import Record
from reproduce.claims import Claim, Share, settle
from reproduce.compare import figures_of
from reproduce.page import Block, Claims, Page, Section, Table, Text, cases_csv, claims_csv, table_csv
from reproduce.shah2013.cases import Sampler
from reproduce.shah2013.claims import BEYOND, CLAIMS
from reproduce.shah2013.deciding import nonsingular, ratio
from reproduce.shah2013.figures import comparison, independent_velocities, method_figure, movie, ratios
from reproduce.shah2013.methods import METHODS
from reproduce.shah2013.runs import COARSE, FINE, Worked, settings
from reproduce.study import STUDIES, Options
from space_envs.system.provenance import commit, machine, versions

OWN = "canonical case"
PACKAGES = ("python", "space-capture", "mujoco", "numpy", "scipy", "casadi")
COMPARED = (
    ("(b) / (a)", "local", ("zeta_zero",)),
    ("(c) / (a)", "ocp", ("zeta_zero",)),
    ("(c) / (b)", "ocp", ("local",)),
    ("(c) / best of (a), (b)", "ocp", ("zeta_zero", "local")),
    ("(c′) / (c)", "ocp_rest", ("ocp",)),
    ("(d) / (c)", "free", ("ocp",)),
)

SPATIAL = (
    "The paper's future work is a spatial robot of 14 joints. Here it is the id "
    "SpaceCapture/DualArmSpatial-v0, with ζ = 0, the local optimisation and free paths as planners. Optimal "
    "control along given paths (eq. 16) is there for the planar robot alone; for the spatial one it comes "
    "with a later version."
)


def build(options: Options, sampler: Sampler, worked: Worked, records: Sequence[Record]) -> Page:
    """The page from the canonical case and the records of the random ones."""
    claims, beyond = settle(CLAIMS, worked.record, records), settle(BEYOND, worked.record, records)
    count = len(records)
    clear = sum(nonsingular(record) for record in records)
    paper: list[Block] = [independent_velocities(worked)]
    paper += [f for key in ("zeta_zero", "local", "ocp") if (f := method_figure(worked, METHODS[key]))]
    extra: list[Block] = [Claims(tuple(beyond), OWN, "random cases")]
    extra += [f for f in (method_figure(worked, METHODS["free"]), ratios(records, worked.record)) if f]
    extra.append(Text((SPATIAL,)))
    return Page(
        name="shah2013",
        title=STUDIES["shah2013"].title,
        lead=_lead(claims),
        notice=f"A quick run: {count} random cases, too few for shares. The full run has "
        f"{STUDIES['shah2013'].cases}."
        if options.quick
        else "",
        chips=(
            (str(count), "random cases"),
            (str(clear), "in which (a), (b), (c) all found a plan"),
            (f"{worked.case.duration:g} s", "of motion"),
        ),
        tiles=_tiles(worked, claims, beyond, records),
        sections=(
            Section("The capture", (movie(worked), _energies(worked), comparison(worked))),
            Section(
                "Claims",
                (
                    Text(
                        (
                            "Every claim of the paper that can be tested, with what was measured on the "
                            f"canonical case and how often it holds over {count} random cases. A claim about "
                            "methods that found no plan in a case is not counted there.",
                        )
                    ),
                    Claims(tuple(claims), OWN, "random cases"),
                ),
            ),
            Section("Figures 2 to 5", tuple(paper)),
            Section("Beyond the paper", tuple(extra)),
            Section("Random cases", (_found(records), _compared(records), _causes(records))),
            Section("What was run", (_assumptions(worked, sampler),)),
        ),
        command=options.command,
        provenance={
            "paper": "S. V. Shah, A. Gattupalli, A. K. Misra, 2013",
            "seed": options.seed,
            "random cases": count,
            "commit": commit(),
            "versions": {name: number for name, number in versions().items() if name in PACKAGES},
            "machine": machine(),
            "processes": options.jobs,
        },
        files=_files(options, sampler, worked, records, claims, beyond),
    )


def _lead(claims: Sequence[Claim]) -> tuple[str, ...]:
    decided = [claim.holds for claim in claims if claim.holds is not None]
    return (
        "The paper plans how two arms on a free-floating satellite take a turning object without turning the "
        "satellite: with ζ = 0 (a), with the least energy at each instant (b), and by optimal control over "
        "the whole motion (c). Here all three run again, on a canonical case that stands in for the paper's "
        "lost Figure 1 and on random ones, beside a method whose end-effector paths are free (d).",
        f"On the canonical case {sum(decided)} of {len(decided)} claims hold as they are counted here.",
    )


def _tiles(
    worked: Worked, claims: Sequence[Claim], beyond: Sequence[Claim], records: Sequence[Record]
) -> tuple[tuple[str, str, str, str], ...]:
    shares = {claim.rule.key: claim.share for claim in (*claims, *beyond)}
    savings = [1.0 - r for record in records if (r := ratio(record, "free", ("ocp",))) is not None]
    fine = [
        found["tracked_base_rate_fine"]
        for key in ("ocp_rest", "free")
        if (found := figures_of(worked.record, key))
    ]
    tiles = []
    for key, label, who in (
        ("local_energy", "Local optimisation costs more", "than ζ = 0"),
        ("ocp_energy", "Optimal control, much lower", "than both, by at least 10 %"),
    ):
        share = shares[key]
        tiles.append((label, _percent(share), "% of cases", who))
    if savings:
        tiles.append(
            (
                "Free paths save",
                f"{100 * float(np.median(savings)):.0f}",
                "% of energy",
                "median, against (c)",
            )
        )
    if fine:
        tiles.append(("Base rate at torque level", f"{max(fine):.1e}", "rad/s", "canonical, (c′) and (d)"))
    return tuple(tiles)


def _percent(share: Share | None) -> str:
    return "-" if share is None or not share.of else f"{100 * share.rate:.0f}"


def _energies(worked: Worked) -> Table:
    """The canonical case, method by method."""
    zero = figures_of(worked.record, "zeta_zero")
    rows = []
    for key, method in METHODS.items():
        found = figures_of(worked.record, key)
        if not found:
            rows.append((method.title, *["-"] * 8))
            continue
        rows.append(
            (
                method.title,
                f"{found['energy']:.6f}",
                f"{found['energy'] / zero['energy']:.4f}" if zero else "-",
                f"{found['work']:.4f}",
                f"{1000 * found['peak_power']:.2f}",
                f"{found['base_rate']:.0e}",
                f"{found['tracked_base_rate']:.1e}",
                f"{found['tracked_base_rate_fine']:.1e}",
                f"{worked.record['timing'][key]:.2f}",
            )
        )
    return Table(
        "Energy of the canonical case",
        (
            "method",
            "C [J s]",
            "C / C of (a)",
            "work of the drives [J]",
            "peak power [mW]",
            "base rate, re-integrated [rad/s]",
            "base rate, simulated [rad/s]",
            "simulated, fine [rad/s]",
            "planning [s]",
        ),
        tuple(rows),
        "C is eq. 15, twice the time integral of kinetic energy. Work is the integral of the sum of "
        "|torque × rate| over the joints, with the kinetic energy of a jump of the rates at t = 0 where "
        "there is one. Simulated: computed torque on a floating base in MuJoCo, RK4, "
        f"{settings(COARSE)}; fine: {settings(FINE)}.",
        colours=tuple(method.colour for method in METHODS.values()),
    )


def _found(records: Sequence[Record]) -> Table:
    """How many plans each method found, and why not."""
    causes = sorted(
        {each["cause"] for record in records for each in record["methods"].values() if "cause" in each}
    )
    rows = []
    for key, method in METHODS.items():
        each = [record["methods"][key] for record in records]
        why = Counter(found["cause"] for found in each if "cause" in found)
        seconds = [record["timing"][key] for record in records]
        rows.append(
            (
                method.title,
                str(len(each) - sum(why.values())),
                *(str(why[cause]) for cause in causes),
                f"{float(np.median(seconds)):.2f}",
            )
        )
    return Table(
        "Plans and failures",
        ("method", "plan found", *(cause.replace("_", " ") for cause in causes), "planning [s], median"),
        tuple(rows),
        "Every drawn case counts once for each method. Failures are typed by the planners; the first reasons "
        "are below.",
        colours=tuple(method.colour for method in METHODS.values()),
    )


def _compared(records: Sequence[Record]) -> Table:
    rows = []
    for name, key, others in COMPARED:
        values = np.array([r for record in records if (r := ratio(record, key, others)) is not None])
        if not values.size:
            rows.append((name, "0", *["-"] * 5))
            continue
        low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
        rows.append(
            (
                name,
                str(values.size),
                f"{middle:.3f}",
                f"{low:.3f}",
                f"{high:.3f}",
                f"{values.max():.3f}",
                f"{100 * float((values <= 1.0 + 1e-9).mean()):.0f}",
            )
        )
    return Table(
        "Ratios of C",
        ("ratio", "cases with both", "median", "10 %", "90 %", "largest", "at most 1 [%]"),
        tuple(rows),
        "Over the cases in which all methods of a ratio found a plan.",
    )


def _causes(records: Sequence[Record]) -> Table:
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
    return Table(
        "First reason for each cause",
        ("method", "cause", "case", "reason"),
        tuple(rows),
        "None." if not rows else "",
        words=True,
    )


def _assumptions(worked: Worked, sampler: Sampler) -> Text:
    case = worked.case
    start = ", ".join(f"{angle:g}" for angle in case.start)
    return Text(
        (
            "Figure 1 of the paper, with the start of the arms and the grapple points, is lost, and so are "
            "the duration and the axes of the other figures. The canonical case is our choice; what the text "
            "gives is kept.",
        ),
        (
            f"Robot: Table I, mounts at (0.5, 0) and (-0.5, 0) m. Target at {case.centre} m, end velocities "
            f"(-0.01, 0) and (0.01, 0) m/s, as in the paper. Start ({start}) rad, grapple points "
            f"{case.half_width} m from the target's centre, duration {case.duration:g} s: our choice.",
            f"Random cases: each joint angle of the start uniform within {sampler.joint} rad of the "
            f"canonical one, the target's centre within {sampler.displacement} m along x and y, its angle at "
            f"the end within {degrees(sampler.angle):.0f} deg, its spin within {degrees(sampler.spin):.0f} "
            f"deg/s of either sign, grapple points {sampler.half_width[0]} to {sampler.half_width[1]} m from "
            "the centre. A draw is kept if the start is within the joint limits and both grapple points lie "
            f"within {100 * sampler.reach:.0f} % of the arms' reach from the system's centre of mass. "
            "Nothing else is rejected. Case k of a seed is the same however many are drawn.",
            *(f"{method.title}: {method.what}." for method in METHODS.values()),
            "Energy: C = integral of θ̇ᵀ I_m θ̇ (eq. 15), I_m the inertia with the base's motion eliminated. "
            "Power: the paper does not define it; here the sum over the joints of |torque × rate|, and "
            "dashed the net power, whose integral is the kinetic energy.",
            "ζ: one direction of the paper's two-vector has no effect; shown is what its projector lets "
            "through. Joint rates are solved from the end-effector velocities and the reactionless "
            "constraint together, so that the generalised Jacobian is never inverted.",
            "Obstacles: none, as in the paper. In the canonical case an arm starts over the target, which in "
            "the plane is possible at different heights only. Method (d) can keep the arms clear of each "
            "other and of the target; the suite's policy of that name does.",
            "Curves, energies and misses are recomputed from the joint motion alone, between the planners' "
            "nodes, by code that no planner uses.",
        ),
    )


def _files(
    options: Options,
    sampler: Sampler,
    worked: Worked,
    records: Sequence[Record],
    claims: Sequence[Claim],
    beyond: Sequence[Claim],
) -> dict[str, tuple[str, str]]:
    summary: dict[str, Any] = {
        "paper": "shah2013",
        "seed": options.seed,
        "sampler": asdict(sampler),
        "canonical": worked.record,
        "claims": [_claim_dict(claim) for claim in (*claims, *beyond)],
        "cases": list(records),
    }
    curves = [
        (key, *map(float, (c.time[k], *c.zeta[k], *c.turning[k], c.base_rate[k], c.energy[k], c.power[k])))
        for key, c in worked.curves.items()
        for k in range(0, len(c.time), 4)
    ]
    curve_heads = ("method", "time", "zeta1", "zeta2", "omega1z", "omega2z", "base_rate", "energy", "power")
    return {
        "summary.json": ("Summary", json.dumps(summary, indent=1, allow_nan=False) + "\n"),
        "cases.csv": ("Cases", cases_csv("case", (worked.record, *records))),
        "curves.csv": ("Curves", table_csv(curve_heads, curves)),
        "claims.csv": ("Claims", claims_csv("canonical", (*claims, *beyond))),
    }


def _claim_dict(claim: Claim) -> dict[str, Any]:
    return {
        "key": claim.rule.key,
        "where": claim.rule.where,
        "says": claim.rule.says,
        "counted": claim.rule.counted,
        "measured": claim.measured,
        "canonical": claim.verdict,
        "share": None if claim.share is None else asdict(claim.share),
    }
