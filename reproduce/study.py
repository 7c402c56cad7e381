"""The papers that can be reproduced, the options of a run, and its provenance."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from space_envs.system.provenance import commit, machine, versions

PACKAGES = ("python", "space-capture", "mujoco", "numpy", "scipy", "casadi")


@dataclass(frozen=True)
class StudyOptions:
    """Options of one run.

    Attributes:
        output: folder of the page. cases: their number. seed: of their draws. jobs: processes.
        quick: whether the page has to say that it rests on few cases. command: as typed, for the page.
        progress: whether to show bars.
    """

    output: Path
    cases: int
    seed: int
    jobs: int
    quick: bool
    command: str
    progress: bool = True


@dataclass(frozen=True)
class Study:
    """A paper that can be reproduced: `reproduce.<name>` has reproduce(options) -> Page.

    Attributes:
        cases, quick: number of cases of a full and of a quick run. of: what the cases are.
    """

    name: str
    title: str
    cases: int
    quick: int
    of: str


STUDIES = {
    study.name: study
    for study in (
        Study(
            "shah2013",
            "Energy optimum reactionless path planning for capture of tumbling orbiting objects using a "
            "dual-arm robot",
            cases=200,
            quick=12,
            of="random cases",
        ),
        Study(
            "shyam2020",
            "Imitation learning for autonomous trajectory learning of robot arms in space",
            cases=50,
            quick=6,
            of="goals of the test split",
        ),
    )
}


def provenance(paper: str, options: StudyOptions, counts: Mapping[str, int]) -> dict[str, Any]:
    """Origin of a page: the paper, the seed, numbers of cases by their name, versions and machine."""
    return {
        "paper": paper,
        "seed": options.seed,
        **counts,
        "commit": commit(),
        "versions": {name: number for name, number in versions().items() if name in PACKAGES},
        "machine": machine(),
        "processes": options.jobs,
    }
