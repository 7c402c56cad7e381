"""The content of the page of shyam2020: what stands in each of its sections, and the files next to it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from reproduce.claims import CaseRecord, Claim, settle
from reproduce.compare import ratios
from reproduce.page.blocks import Block, ClaimTable, Page, Prose, sections, tiles
from reproduce.page.csv_tables import cases_csv, claims_csv, table_csv
from reproduce.shyam2020.cases import C
from reproduce.shyam2020.demonstrated import DemonstratedWorkspace
from reproduce.shyam2020.feedback import FeedbackResult
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.page import tables
from reproduce.shyam2020.page.claims import BEYOND, CLAIMS, sampling_gain
from reproduce.shyam2020.page.comparisons import compared
from reproduce.shyam2020.page.demonstrations import learned, variations, workspace
from reproduce.shyam2020.page.feedback import feedback_figure, feedback_table
from reproduce.shyam2020.page.figures import base_motion, basis, costs
from reproduce.shyam2020.page.model import model_tables
from reproduce.shyam2020.page.text import TEXT
from reproduce.shyam2020.page.vectors import poses, trajectories, vectors
from reproduce.shyam2020.runs import PlannedGoal
from reproduce.shyam2020.timing import StepTimes
from reproduce.study import STUDIES, StudyOptions, provenance

STUDY = STUDIES["shyam2020"]
OWN, RANDOM = TEXT.fill("page.own"), TEXT.fill("page.random")
RATIOS = (("promp", "minimum_jerk"), ("promp", "ocp"), ("promp_optimal", "ocp"))  # of costs, in tiles
EVERY = 10  # samples of a course between those in the file of curves
CURVES = (
    *("method", "time"),
    *(f"{what}_{axis}" for what in ("rotation", "base", "end_effector") for axis in "xyz"),
    "cost",
)


def build(
    options: StudyOptions,
    planned: PlannedGoal,
    steps: StepTimes,
    covered: DemonstratedWorkspace,
    controlled: FeedbackResult | None,
    records: Sequence[CaseRecord],
) -> Page:
    """The page of shyam2020.

    Args:
        planned: the own goal. steps: times of the algorithm's steps. covered: demonstrations. controlled: the
            control law on the own goal, if that has a joint goal. records: of the test goals.
    """
    claims, beyond = settle(CLAIMS, planned.record, records), settle(BEYOND, planned.record, records)
    count = len(records)
    asked = [claim.share for claim in claims if claim.share and claim.share.of]
    most = sum(2 * share.holds > share.of for share in asked)
    figures = (str(count), str(len(METHODS)), f"{planned.case.reach().duration:g} s")
    blocks = {
        "compared": (tables.comparison(records), compared(records), tables.drives(records)),
        "claims": (
            Prose(*TEXT.paragraphs("texts.claims", count=count)),
            ClaimTable(tuple(claims), OWN, RANDOM),
        ),
        "demonstrations": (
            workspace(covered),
            variations(covered),
            learned(covered, planned.case, options.seed),
        ),
        "figures": _figures(planned),
        "model": model_tables(),
        "times": (tables.step_times(steps), tables.planning_times(records)),
        "control": (
            Prose(*TEXT.paragraphs("texts.control")),
            *((feedback_figure(controlled), feedback_table(controlled)) if controlled else ()),
        ),
        "beyond": (
            ClaimTable(tuple(beyond), OWN, RANDOM),
            base_motion(planned, "promp_optimal_kept", "kept"),
            Prose(*TEXT.paragraphs("texts.future")),
        ),
        "failures": (tables.failures(records),),
        "run": (_run(planned, options),),
    }
    return Page(
        name=STUDY.name,
        title=STUDY.title,
        lead=TEXT.paragraphs("page.lead", asked=len(asked), most=most, count=count, c=C)[0],
        notice=TEXT.fill("page.notice", count=count, full=STUDY.cases) if options.quick else "",
        chips=tuple(zip(figures, TEXT.fill("page.chips"), strict=True)),
        tiles=tiles(TEXT, _tile_figures(records)),
        sections=sections(TEXT, blocks),
        command=options.command,
        provenance=provenance(TEXT.fill("page.paper"), options, {"goals": count}),
        files=_files(options, planned, records, [*claims, *beyond]),
    )


def _figures(planned: PlannedGoal) -> Sequence[Block | None]:
    """Figures 2 to 6 of the paper."""
    motion, drawn = base_motion(planned, "promp", "fig5"), planned.drawn
    if not drawn or "promp" not in planned.courses:
        return (vectors(), motion, basis())
    picture = poses(planned.case, planned.courses["promp"])
    return (vectors(), picture, trajectories(planned, drawn), costs(planned, drawn), motion, basis())


def _run(planned: PlannedGoal, options: StudyOptions) -> Prose:
    """Text about assumptions and settings."""
    position = ", ".join(f"{value:.3f}" for value in planned.case.position)
    methods = [(method.name, TEXT.fill(f"methods.{key}")) for key, method in METHODS.items()]
    return Prose(*TEXT.paragraphs("texts.run", position=position, methods=methods, seed=options.seed))


def _tile_figures(records: Sequence[CaseRecord]) -> dict[str, str]:
    """Figures of the tiles by key, of those that there are."""
    figures = {}
    gains = [100 * (1.0 - gain) for record in records if (gain := sampling_gain(record, 100)) is not None]
    if gains:
        figures["sampling"] = f"{np.median(gains):.0f}"
    for key, other in RATIOS:
        values = ratios(records, "cost", key, other)
        if values.size:
            figures[f"{key} / {other}"] = f"{np.median(values):.2f}"
    return figures


def _files(
    options: StudyOptions, planned: PlannedGoal, records: Sequence[CaseRecord], claims: Sequence[Claim]
) -> Mapping[str, tuple[str, str]]:
    summary: dict[str, Any] = {
        "paper": STUDY.name,
        "seed": options.seed,
        "own": planned.record,
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
        (key, *map(float, (c.time[k], *c.rotation[k], *c.base[k], *c.end_effector[k], c.running[k])))
        for key, c in planned.courses.items()
        for k in range(0, len(c.time), EVERY)
    ]
    return {
        "summary.json": ("Summary", json.dumps(summary, indent=1, allow_nan=False) + "\n"),
        "cases.csv": ("Cases", cases_csv("goal", (planned.record, *records))),
        "curves.csv": ("Curves", table_csv(CURVES, curves)),
        "claims.csv": ("Claims", claims_csv("own", claims)),
    }
