"""Every page that the project can write, in a real Chromium at three widths, light and dark.

What counts as a fault stands in `page_layout`. Reports are of made-up episodes; pages of papers have all
kinds of blocks, with the papers' own claims. The runs of the papers in their own tests open what they wrote.
"""

import io
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from page_layout import layout_faults
from PIL import Image
from playwright.sync_api import Browser
from synthetic_results import make_picture

import reproduce
import space_envs
from reproduce.animation import Chain, Movie, Scene, animate
from reproduce.claims import Claim, Share
from reproduce.figures import Sketch, figure
from reproduce.page import Claims, Page, Picture, Section, Table, Text, write_page
from reproduce.shah2013.claims import CLAIMS as SHAH2013
from reproduce.shyam2020.claims import CLAIMS as SHYAM2020
from reproduce.study import STUDIES

TEMPLATES = {"report.html.j2", "page.html.j2"}


def test_there_is_no_other_page() -> None:
    """A new kind of page needs a test of its layout."""
    packages = [Path(next(iter(package.__path__))) for package in (space_envs, reproduce)]
    packages.append(packages[0].parent / "agents")
    found = {path.name for package in packages for path in package.rglob("*.j2")}
    assert found == TEMPLATES
    html = {
        path.name for package in packages for path in package.rglob("*.py") if "<!doctype" in path.read_text()
    }
    assert html == set()


# Pages of the papers


def wave(axes: Axes) -> None:
    t = np.linspace(0.0, 20.0, 50)
    axes.plot(t, np.sin(t), label="joint 1")
    axes.set(xlabel="time [s]", ylabel="joint velocity [rad/s]")
    axes.legend()


def movie() -> Movie:
    """Two robots with two links an arm that wave."""
    t = np.linspace(0.0, 1.0, 5)
    chains = [
        Chain(np.array([0.5, side]), (1.0, 0.7), np.stack([side * t, t], axis=1), colour)
        for side, colour in ((0.3, "#0072b2"), (-0.3, "#d55e00"))
    ]
    trails = [np.stack([t, t], axis=1), np.stack([t, -t], axis=1)]
    grapples = np.array([[0.0, 0.3], [0.0, -0.3]])
    scenes = [
        Scene(title, np.zeros((5, 2)), t, chains, np.ones(2), t, grapples, trails, t, 1.0, "C = 0.7505 J s")
        for title in ("(a) zeta = 0", "(c) optimal control, from rest")
    ]
    svg, seconds = animate(scenes, 5.0, (-1.3, -1.0, 3.2, 2.6))
    return Movie("capture", "The canonical capture", "A caption. " * 20, svg, "Two robots.", 20.0, seconds)


def paper(name: str, rules: tuple, jpeg: bytes) -> Page:
    """A page with blocks of all kinds; its claims are the paper's own, with made-up results."""
    verdicts = cycle((True, False, None))
    shares = cycle((Share(17, 50, 3), Share(0, 0, 50), Share(50, 50)))
    claims = tuple(Claim(rule, rule.counted, next(verdicts), next(shares)) for rule in rules)
    heads = ("method", "eq. 20 [cm²/s]", "base rate, re-integrated [rad/s]", "peak acceleration [rad/s²]")
    names = ("(c′) optimal control from rest", "ProMP weights, attitude kept")
    rows = tuple((name, *(f"{number}.{number}e-12" for number in range(1, 13))) for name in names)
    reason = "infeasible: joint 3 would need 0.383 rad/s, which is more than the 0.35 rad/s of its drive"
    return Page(
        name=name,
        title=STUDIES[name].title,
        lead=("A paragraph of some words that says what the paper is about. " * 5,),
        notice="A quick run: 2 random cases; the full page rests on 200.",
        chips=(("200", STUDIES[name].of), ("7", "methods")),
        tiles=(
            ("Least energy", "0.7505", "J s", "optimal_control_collocation_attitude_kept"),
            ("Eq. 20", "11.52", "cm²/s", "ProMP weights, optimal"),
            ("Claims that hold", "14 of 19", "", "on the paper's own case"),
        ),
        sections=(
            Section(
                "What moves",
                (movie(), Picture("poses", "Poses", "Four poses.", "An arm.", jpeg), Text(("Words. " * 60,))),
            ),
            Section(
                "Claims and what came of each of them", (Claims(claims, "on its own case", "goals"),)
            ),
            Section(
                "Figures and tables",
                (
                    figure("one", "One panel", "A caption.", [Sketch(wave, "A wave.")]),
                    figure("many", "Many panels", "A caption.", [Sketch(wave, "A wave.")] * 6),
                    Table("Wide", (heads[0], *heads[1:] * 4), rows, "A caption.", colours=("#0072b2",) * 2),
                    Table("Words", ("method", "cause", "case", "reason"), ((names[0], reason, "3", reason),),
                          words=True),
                ),
            ),
        ),
        command=f"python -m reproduce {name} --cases 200 --seed 0 --jobs 2 --output results/{name}_again",
        provenance={"versions": {"numpy": "2.4.6"}, "seeds": list(range(60))},
        files={"cases.csv": ("Cases", "a,b\n")},
    )  # fmt: skip


@pytest.fixture(scope="module")
def jpeg() -> bytes:
    content = io.BytesIO()
    Image.fromarray(make_picture(0.5)).save(content, format="JPEG")
    return content.getvalue()


@pytest.mark.parametrize(("name", "rules"), [("shah2013", SHAH2013), ("shyam2020", SHYAM2020)])
def test_pages_of_papers(browser: Browser, tmp_path: Path, name: str, rules: tuple, jpeg: bytes) -> None:
    written = write_page(paper(name, rules, jpeg), tmp_path)
    assert layout_faults(browser, written["Page"].as_uri()) == []
