"""The content of the page of shah2013: what stands in each of its sections, and the files next to it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from reproduce.claims import CaseRecord, Claim, settle
from reproduce.compare import figures_of, ratios
from reproduce.page.blocks import Block, ClaimTable, Page, Prose, sections, tiles
from reproduce.page.csv_tables import cases_csv, claims_csv, table_csv
from reproduce.shah2013 import tables
from reproduce.shah2013.cases import Sampler
from reproduce.shah2013.claims import BEYOND, CLAIMS, nonsingular
from reproduce.shah2013.comparisons import comparison, energy_ratios, movie
from reproduce.shah2013.figures import independent_velocities, method_figure
from reproduce.shah2013.methods import METHODS
from reproduce.shah2013.runs import PlannedCase
from reproduce.shah2013.text import TEXT
from reproduce.study import STUDIES, StudyOptions, provenance

STUDY = STUDIES["shah2013"]
OWN, RANDOM = TEXT.fill("page.own"), TEXT.fill("page.random")
CURVES = ("method", "time", "zeta1", "zeta2", "omega1z", "omega2z", "base_rate", "energy", "power")


def build(
    options: StudyOptions, sampler: Sampler, planned: PlannedCase, records: Sequence[CaseRecord]
) -> Page:
    """The page from the canonical case and the records of the random ones."""
    claims, beyond = settle(CLAIMS, planned.record, records), settle(BEYOND, planned.record, records)
    decided = [claim.holds for claim in claims if claim.holds is not None]
    count = len(records)
    figures = (str(count), str(sum(map(nonsingular, records))), f"{planned.case.duration:g} s")
    return Page(
        name=STUDY.name,
        title=STUDY.title,
        lead=TEXT.paragraphs("page.lead", holding=sum(decided), decided=len(decided))[0],
        notice=TEXT.fill("page.notice", count=count, full=STUDY.cases) if options.quick else "",
        chips=tuple(zip(figures, TEXT.fill("page.chips"), strict=True)),
        tiles=tiles(TEXT, _tile_figures(planned, [*claims, *beyond], records)),
        sections=sections(TEXT, _blocks(sampler, planned, records, claims, beyond)),
        command=options.command,
        provenance=provenance(TEXT.fill("page.paper"), options, {RANDOM: count}),
        files=_files(options, sampler, planned, records, [*claims, *beyond]),
    )


def _blocks(
    sampler: Sampler,
    planned: PlannedCase,
    records: Sequence[CaseRecord],
    claims: Sequence[Claim],
    beyond: Sequence[Claim],
) -> Mapping[str, Sequence[Block | None]]:
    """Blocks of each section by its key; None where there is nothing to show."""
    methods = [(method.title, TEXT.fill(f"methods.{key}")) for key, method in METHODS.items()]
    return {
        "capture": (movie(planned), tables.energies(planned), comparison(planned)),
        "claims": (
            Prose(*TEXT.paragraphs("texts.claims", count=len(records))),
            ClaimTable(tuple(claims), OWN, RANDOM),
        ),
        "figures": (
            independent_velocities(planned),
            *(method_figure(planned, METHODS[key]) for key in ("zeta_zero", "local", "ocp")),
        ),
        "beyond": (
            ClaimTable(tuple(beyond), OWN, RANDOM),
            method_figure(planned, METHODS["free"]),
            energy_ratios(records, planned.record),
            Prose(*TEXT.paragraphs("texts.spatial")),
        ),
        "random": (
            tables.plans_found(records),
            tables.energy_ratios(records),
            tables.first_reasons(records),
        ),
        "run": (Prose(*TEXT.paragraphs("texts.run", case=planned.case, sampler=sampler, methods=methods)),),
    }


def _tile_figures(
    planned: PlannedCase, claims: Sequence[Claim], records: Sequence[CaseRecord]
) -> dict[str, str]:
    """Figures of the tiles by key, of those that there are."""
    shares = {claim.rule.key: claim.share for claim in claims}
    figures = {
        key: "-" if (share := shares[key]) is None or not share.of else f"{100 * share.rate:.0f}"
        for key in ("local_energy", "ocp_energy")
    }
    savings = 1.0 - ratios(records, "energy", "free", "ocp")
    if savings.size:
        figures["saving"] = f"{100 * float(np.median(savings)):.0f}"
    rates = [
        found["tracked_base_rate_fine"]
        for key in ("ocp_rest", "free")
        if (found := figures_of(planned.record, key))
    ]
    return figures | ({"base_rate": f"{max(rates):.1e}"} if rates else {})


def _files(
    options: StudyOptions,
    sampler: Sampler,
    planned: PlannedCase,
    records: Sequence[CaseRecord],
    claims: Sequence[Claim],
) -> dict[str, tuple[str, str]]:
    summary: dict[str, Any] = {
        "paper": STUDY.name,
        "seed": options.seed,
        "sampler": asdict(sampler),
        "canonical": planned.record,
        "claims": [_claim_dict(claim) for claim in claims],
        "cases": list(records),
    }
    curves = [
        (key, *map(float, (c.time[k], *c.zeta[k], *c.angular[k], c.base_rate[k], c.energy[k], c.power[k])))
        for key, c in planned.curves.items()
        for k in range(0, len(c.time), 4)
    ]
    return {
        "summary.json": ("Summary", json.dumps(summary, indent=1, allow_nan=False) + "\n"),
        "cases.csv": ("Cases", cases_csv("case", (planned.record, *records))),
        "curves.csv": ("Curves", table_csv(CURVES, curves)),
        "claims.csv": ("Claims", claims_csv("canonical", claims)),
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
