"""What the command line asks of a paper's package."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Options:
    """Of one run.

    Attributes:
        output: folder of the page. cases: number of random cases. seed: of their draws. jobs: processes.
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
        cases, quick: random cases of a full and of a quick run.
    """

    name: str
    title: str
    cases: int
    quick: int


STUDIES = {
    study.name: study
    for study in (
        Study(
            "shah2013",
            "Energy optimum reactionless path planning for capture of tumbling orbiting objects using a "
            "dual-arm robot",
            cases=200,
            quick=12,
        ),
    )
}
