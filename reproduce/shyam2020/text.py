"""The page of shyam2020: its words, tables and files, around the figures and claims."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import degrees
from typing import Any

import numpy as np

from reproduce.cases import Record
from reproduce.claims import Claim, settle
from reproduce.compare import figures_of
from reproduce.page import Block, Claims, Page, Section, Table, Text, cases_csv, claims_csv, table_csv
from reproduce.shyam2020.cases import DIFFICULTY, C, limits
from reproduce.shyam2020.claims import BEYOND, CLAIMS
from reproduce.shyam2020.deciding import MET, sampling_gain
from reproduce.shyam2020.demonstrated import Covered, learned, variations, workspace
from reproduce.shyam2020.feedback import Feedback, feedback_figure, feedback_table
from reproduce.shyam2020.figures import (
    base_motion,
    basis,
    compared,
    costs,
    ratios_to,
    trajectories,
    vectors,
)
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.pictures import poses
from reproduce.shyam2020.runs import Worked
from reproduce.shyam2020.tables import model_tables, short, time_tables
from reproduce.study import STUDIES, Options
from space_envs.system.provenance import commit, machine, versions

OWN = "own goal"
GOALS = "test goals"
PACKAGES = ("python", "space-capture", "mujoco", "numpy", "scipy", "casadi")
STUDY = STUDIES["shyam2020"]


def build(
    options: Options,
    worked: Worked,
    steps: Mapping[str, tuple[str, list[float]]],
    covered: Covered,
    controlled: Feedback | None,
    records: Sequence[Record],
) -> Page:
    """The page.

    Args:
        worked: the own goal. steps: times of the algorithm's steps. covered: demonstrations. controlled: the
            control law on the own goal, if that has a joint goal. records: of the test goals.
    """
    claims, beyond = settle(CLAIMS, worked.record, records), settle(BEYOND, worked.record, records)
    count = len(records)
    return Page(
        name=STUDY.name,
        title=STUDY.title,
        lead=_lead(claims, records),
        notice=f"A quick run: only {count} of the goals, too few for shares. The full run has {STUDY.cases}."
        if options.quick
        else "",
        chips=(
            (str(count), "unseen goals"),
            (str(len(METHODS)), "planners"),
            (f"{worked.case.reach().duration:g} s", "of motion"),
        ),
        tiles=_tiles(records),
        sections=(
            Section("Planners compared", (comparison(records), compared(records), kept_table(records))),
            Section(
                "Claims",
                (
                    Text(
                        (
                            "Every claim of the paper that can be tested, with what was measured on the "
                            "page's "
                            f"own goal and how often it holds over {count} goals of the test split. A goal "
                            "that lacks what a claim is about is not counted there.",
                        )
                    ),
                    Claims(tuple(claims), OWN, GOALS),
                ),
            ),
            Section(
                "Demonstrations",
                (workspace(covered), variations(covered), learned(covered, worked.case, options.seed)),
            ),
            Section("Figures 2 to 6", tuple(_figures(worked))),
            Section("Tables I and II", model_tables()),
            Section("Planning times", time_tables(steps, records)),
            Section("Control from the learned distribution", tuple(_control(controlled))),
            Section("Beyond the paper", tuple(_beyond(worked, beyond))),
            Section("Failures", (_failures(records),)),
            Section("What was run", (_assumptions(worked, options),)),
        ),
        command=options.command,
        provenance={
            "paper": "R. B. A. Shyam, Z. Hao, U. Montanaro, G. Neumann, 2020",
            "seed": options.seed,
            "goals": count,
            "commit": commit(),
            "versions": {name: number for name, number in versions().items() if name in PACKAGES},
            "machine": machine(),
            "processes": options.jobs,
        },
        files=_files(options, worked, records, [*claims, *beyond]),
    )


def _lead(claims: Sequence[Claim], records: Sequence[Record]) -> tuple[str, ...]:
    asked = [claim.share for claim in claims if claim.share and claim.share.of]
    most = sum(2 * share.holds > share.of for share in asked)
    return (
        "The paper learns a distribution over joint motions, a ProMP, from demonstrations of a "
        "linear-quadratic "
        "controller. For a new goal it conditions the distribution, samples, and takes the motion that "
        "disturbs "
        "the free-floating satellite least. Here the algorithm runs again beside minimum-jerk interpolation, "
        "which learns nothing, optimal control, which is the reference, and an optimiser in the ProMP's own "
        "weights.",
        f"Of {len(asked)} claims that are counted, {most} hold for more than half of the {len(records)} "
        "unseen "
        "goals. Costs are eq. 20 of the paper times the time step, over the whole motion, c = "
        f"{C:g} m/rad.",
    )


def _tiles(records: Sequence[Record]) -> tuple[tuple[str, str, str, str], ...]:
    gains = [100 * (1.0 - r) for record in records if (r := sampling_gain(record, 100)) is not None]
    tiles = []
    if gains:
        tiles.append(("Sampling lowers the cost by", f"{np.median(gains):.0f}", "%", "best of 100, median"))
    for key, other, label in (
        ("promp", "minimum_jerk", "The paper's plan costs"),
        ("promp", "ocp", "The paper's plan costs"),
        ("promp_optimal", "ocp", "Optimal weights cost"),
    ):
        values = ratios_to(records, key, other)
        if values.size:
            tiles.append((label, f"{np.median(values):.2f}", "times", f"{METHODS[other].name}, median"))
    return tuple(tiles)


def comparison(records: Sequence[Record]) -> Table:
    """Every planner over the goals."""
    rows = []
    for key, method in METHODS.items():
        found = [each for record in records if (each := figures_of(record, key))]
        if not found:
            rows.append((method.name, "0", *["-"] * 8))
            continue

        def middle(name: str, scale: float, found: Sequence[Mapping[str, float]] = found) -> str:
            return short(scale * float(np.median([each[name] for each in found])))

        ratios = ratios_to(records, key)
        rows.append(
            (
                method.name,
                str(len(found)),
                middle("cost", 1e4),
                *(f"{q:.2f}" for q in (np.quantile(ratios, [0.5, 0.9]) if ratios.size else [np.nan] * 2)),
                middle("end_attitude", degrees(1.0)),
                middle("peak_attitude", degrees(1.0)),
                f"{1000 * max(each['position_error'] for each in found):.2g}",
                f"{degrees(max(each['rotation_error'] for each in found)):.2g}",
                short(1000 * float(np.median([record["timing"][key] for record in records]))),
            )
        )
    return Table(
        f"Eq. 20 and attitude over {len(records)} unseen goals",
        (
            "planner",
            "plans",
            "eq. 20 [cm²/s]",
            "over optimal control",
            "90 %",
            "end attitude [deg]",
            "peak attitude [deg]",
            "goal error, largest [mm]",
            "goal error, largest [deg]",
            "planning [ms]",
        ),
        tuple(rows),
        f"Goals 0 to {len(records) - 1} of the test split, difficulty {DIFFICULTY}; nothing was tuned on it. "
        "Medians if nothing else is said. The ratio is that of the same goal's costs, to optimal "
        "control with "
        "the attitude free. All motions are measured by one independent roll-out at 1001 times, from "
        "start to "
        "rest.",
        colours=tuple(method.colour for method in METHODS.values()),
    )


def kept_table(records: Sequence[Record]) -> Table:
    """What the drives have to give, and the attitude-kept optimum."""
    rows = []
    for key, method in METHODS.items():
        found = [each for record in records if (each := figures_of(record, key))]
        if not found:
            rows.append((method.name, *["-"] * 6))
            continue
        rows.append(
            (
                method.name,
                *(
                    f"{max(each[name] for each in found):.3g}"
                    for name in ("peak_rate", "peak_acceleration", "peak_torque", "end_rate")
                ),
                f"{100 * max(each['shift'] for each in found):.3g}",
                f"{np.median(ratios):.2f}" if (ratios := ratios_to(records, key, "ocp_kept")).size else "-",
            )
        )
    bounds = limits()
    return Table(
        "What the motions ask of the drives",
        (
            "planner",
            "rate [rad/s]",
            "acceleration [rad/s²]",
            "torque [N m]",
            "joint rate at the end [rad/s]",
            "shift of the base [cm]",
            "over optimal control, attitude kept",
        ),
        tuple(rows),
        f"Largest of any joint, time and goal; the last column is the median. Limits of the model: "
        f"{bounds.rate:g} rad/s, {bounds.acceleration:g} rad/s², {bounds.torque:g} N m, our choice. Optimal "
        "control and the planner in the weights are given them all, the ProMP's samples the first two. "
        "Torques are "
        "MuJoCo's, at every fifth of the times.",
        colours=tuple(method.colour for method in METHODS.values()),
    )


def _figures(worked: Worked) -> list[Block]:
    blocks: list[Block] = [vectors()]
    if worked.drawn and "promp" in worked.courses:
        blocks += [
            poses(worked.case, worked.courses["promp"]),
            trajectories(worked, worked.drawn),
            costs(worked, worked.drawn),
        ]
    motion = base_motion(
        worked,
        "promp",
        "fig5",
        "Fig. 5: pose of the spacecraft along the trajectory of minimum cost",
        "Best of 100 samples.",
    )
    return [*blocks, *([motion] if motion else []), basis()]


def _control(found: Feedback | None) -> list[Block]:
    words = Text(
        (
            "Section VII names a control strategy from the learned distribution, simulated in a physics "
            "engine, as a way forward. Here it is a policy of the suite, promp_feedback: a law that is "
            "linear in joint angles and rates, whose gains and noise reproduce the mean and the covariance "
            "of the ProMP that is conditioned on start and goal.",
        )
    )
    return [words, *([feedback_figure(found), feedback_table(found)] if found else [])]


def _beyond(worked: Worked, beyond: Sequence[Claim]) -> list[Block]:
    motion = base_motion(
        worked,
        "promp_optimal_kept",
        "kept",
        "The same goal with the attitude kept",
        "Optimal in the ProMP's weights with the first attitude at the end.",
    )
    return [
        Claims(tuple(beyond), OWN, GOALS),
        *([motion] if motion else []),
        Text(
            ("What the paper names as future work, and where it is here:",),
            (
                "Obstacle-free trajectories from the variance in a cluttered space: the id "
                "SpaceCapture/SingleArmCluttered-v0 has keep-out balls between start and goal. The "
                "claims about "
                "a ball above show how far samples alone get, and what an optimiser makes of the same ball.",
                "A control strategy from the learned distribution, simulated in a physics engine: the "
                "section above, and policy promp_feedback, which python evaluate.py compares with the "
                "others.",
            ),
        ),
    ]


def _failures(records: Sequence[Record]) -> Table:
    rows = []
    for key, method in METHODS.items():
        each = [(record["index"], record["methods"][key]) for record in records]
        why = Counter(found["cause"] for _, found in each if "cause" in found)
        for cause, number in sorted(why.items()):
            index, reason = next((i, f["reason"]) for i, f in each if f.get("cause") == cause)
            rows.append((method.name, cause.replace("_", " "), str(number), str(index), reason))
    return Table(
        "Goals without a plan",
        ("planner", "cause", "goals", "first", "its reason"),
        tuple(rows),
        "" if rows else "None.",
        words=True,
    )


def _assumptions(worked: Worked, options: Options) -> Text:
    position = ", ".join(f"{value:.3f}" for value in worked.case.position)
    return Text(
        (
            "The goal pose of the paper's figures stands in a picture only, and so do its axes. The "
            "page's own "
            f"goal is the first of the validation split, at ({position}) m in the base's first frame; "
            "figures "
            "show it, and every count is over the test split.",
        ),
        (
            "Robot: Tables I and II, the satellite and the arm at rest at home, momentum zero, the base "
            "free. "
            "Every motion takes 10 s and ends at rest at an inertial pose of the end-effector.",
            *(f"{method.name}: {method.what}." for method in METHODS.values()),
            "The ProMP is the one that is shipped, fitted to 540 demonstrations over goals of the train "
            "split, 180 for each of three variations: cost matrices and noise as in the paper, and elastic "
            "bands in joint space, where the paper's are in task space (see Demonstrations). Its samples "
            f"come from seed {options.seed}.",
            "Joint goals of minimum jerk, the controller and the ProMP come from inverse kinematics in "
            "the base "
            "frame that the motion itself will end in; the paper does not say how. Optimisers leave the "
            "posture "
            "at the goal free.",
            "Cost: eq. 20 times the time step, the integral of c² ω·ω + v·v of the satellite, which does not "
            "depend on the sampling rate, over the whole motion. The suite's leaderboard has costs of "
            "episodes, "
            "which end at the capture.",
            f"A goal counts as met within {1000 * MET[0]:g} mm and {degrees(MET[1]):.2f} deg.",
        ),
    )


def _files(
    options: Options, worked: Worked, records: Sequence[Record], claims: Sequence[Claim]
) -> dict[str, tuple[str, str]]:
    summary: dict[str, Any] = {
        "paper": STUDY.name,
        "seed": options.seed,
        "own": worked.record,
        "claims": [
            {
                "key": claim.rule.key,
                "measured": claim.measured,
                "holds": claim.holds,
                "share": asdict(claim.share) if claim.share else None,
            }
            for claim in claims
        ],
        "cases": list(records),
    }
    curves = [
        (key, *map(float, (c.time[k], *c.rotation[k], *c.base[k], *c.tip[k], c.running[k])))
        for key, c in worked.courses.items()
        for k in range(0, len(c.time), 10)
    ]
    place = ("x", "y", "z")
    curve_heads = (
        "method",
        "time",
        *(f"{what}_{axis}" for what in ("rotation", "base", "tip") for axis in place),
        "cost",
    )
    return {
        "summary.json": ("Summary", json.dumps(summary, indent=1, allow_nan=False) + "\n"),
        "cases.csv": ("Cases", cases_csv("goal", (worked.record, *records))),
        "curves.csv": ("Curves", table_csv(curve_heads, curves)),
        "claims.csv": ("Claims", claims_csv("own", claims)),
    }
