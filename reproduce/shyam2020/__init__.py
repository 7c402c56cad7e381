"""shyam2020: imitation learning for trajectories of robot arms in space, from our own runs."""

from functools import partial

from tqdm import tqdm

from agents.demonstrations.storage import COUNT
from reproduce.cases import run_cases
from reproduce.page.blocks import Page
from reproduce.shyam2020.cases import check_count, goal
from reproduce.shyam2020.demonstrated import QUICK, cover
from reproduce.shyam2020.feedback import simulate_law
from reproduce.shyam2020.page.content import build
from reproduce.shyam2020.runs import case_record, recipe, work_out
from reproduce.shyam2020.timing import step_times
from reproduce.study import StudyOptions
from space_envs.system.digests import json_digest


def reproduce(options: StudyOptions) -> Page:
    """Work out the page's own goal and those of the test split, and make the page of them.

    Raises:
        ConfigurationError: for more cases than the test split has. SpaceEnvsError: if the output cannot be
            written.
    """
    check_count(options.cases)
    with tqdm(total=4, desc="own goal", unit="step", disable=not options.progress) as bar:
        planned = work_out(goal(-1), options.seed)
        bar.update()
        steps = step_times(goal(-1), options.seed)
        bar.update()
        covered = cover(options.seed, QUICK if options.quick else COUNT)
        bar.update()
        controlled = simulate_law(goal(-1), options.seed)
        bar.update()
    records = run_cases(
        partial(case_record, seed=options.seed),
        options.cases,
        options.output / "cases" / f"{json_digest(recipe(options.seed), 16)}.jsonl",
        jobs=options.jobs,
        progress=options.progress,
    )
    return build(options, planned, steps, covered, controlled, records)
