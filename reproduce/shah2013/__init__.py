"""shah2013: energy optimum reactionless path planning with a dual-arm robot, from our own runs."""

from functools import partial

from tqdm import tqdm

from reproduce.cases import run_cases
from reproduce.page.blocks import Page
from reproduce.shah2013.cases import CANONICAL, Sampler
from reproduce.shah2013.content import build
from reproduce.shah2013.methods import METHODS
from reproduce.shah2013.runs import case_record, recipe, work_out
from reproduce.study import StudyOptions
from space_envs.system.digests import json_digest


def reproduce(options: StudyOptions) -> Page:
    """Work out the canonical case and the random ones, and make the page of them.

    Raises:
        SpaceEnvsError: if the output cannot be written.
    """
    sampler = Sampler()
    with tqdm(total=1, desc="canonical", unit="case", disable=not options.progress) as bar:
        # What is built at the first call of a planner does not count as planning.
        for method in METHODS.values():
            method.plan(CANONICAL)
        planned = work_out(CANONICAL, fine=True)
        bar.update()
    records = run_cases(
        partial(case_record, seed=options.seed, sampler=sampler),
        options.cases,
        options.output / "cases" / f"{json_digest(recipe(options.seed, sampler), 16)}.jsonl",
        jobs=options.jobs,
        progress=options.progress,
    )
    return build(options, sampler, planned, records)
