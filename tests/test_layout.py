"""Every page that the project can write, in a real Chromium at three widths, light and dark.

What counts as a fault stands in `page_layout`. Reports are of made-up episodes; pages of papers have all
kinds of blocks, with the papers' own claims. The runs of the papers in their own tests open what they wrote.
"""

import io
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from page_layout import layout_faults, until
from PIL import Image
from playwright.sync_api import Browser
from synthetic_results import (
    CHARACTERS,
    HOSTILE,
    Character,
    make_picture,
    make_played,
    make_record,
    make_result,
)

import reproduce
import space_envs
from reproduce.claims import Claim, Share
from reproduce.page.animation import AnimatedRobot, Chain, Movie, animate
from reproduce.page.blocks import ClaimTable, Page, Picture, Prose, Section, Table
from reproduce.page.figures import figure
from reproduce.page.writing import write_page
from reproduce.shah2013.claims import CLAIMS as SHAH2013
from reproduce.shyam2020.page.claims import CLAIMS as SHYAM2020
from reproduce.study import STUDIES
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.replay.replay import make_replays
from space_envs.evaluation.report.page.html import to_html
from space_envs.evaluation.report.page.scores import all_scores
from space_envs.evaluation.report.plots.all_plots import make_plots
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.registration import ENTRIES
from space_envs.robots.check.figures.robot_figures import robot_figures
from space_envs.robots.check.implausible import implausible
from space_envs.robots.check.page import RobotReport
from space_envs.robots.check.page import write_page as write_robot_page
from space_envs.robots.check.pictures import RobotPicture
from space_envs.robots.check.planners import PlannerFigures
from space_envs.robots.check.tables import figure_tables, planner_table, verification_table
from space_envs.robots.check.verification import Verification
from space_envs.robots.zoo import find_robot

TEMPLATES = {"report.html.j2", "page.html.j2", "robot.html.j2"}


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


# Reports


def large() -> EvaluationResult:
    """Seven tasks, one of them with fourteen policies of long names, with plots, replays and pictures."""
    odd = ("promp_demonstrated_by_optimal_control", "my_package.planners.receding_horizon:Planner", HOSTILE)
    extra = {name: Character(0.9, 2e-5, 4e-6, 2e-5, 19.7, 218.0, 0.33) for name in odd}
    extra |= {f"reactionless_{number}": CHARACTERS["ppo"] for number in range(3)}
    made = make_result(episodes=8, seeds=2, pictures=True, extra=extra)
    played = make_played("minimum_jerk", episodes=2)
    mine = [replace(record, policy="watched", checksum="") for record in played.records]
    others = [
        make_record(env_id=env_id, difficulty=difficulty, policy=policy)
        for env_id in list(ENTRIES)[1:]
        for difficulty in ("easy", "hard")
        for policy in ("bc", "promp_demonstrated")
    ]
    return replace(
        made,
        records=[*made.records, *mine, *others],
        replays={mine[0].entry: make_replays(played.task, played.episodes, mine)},
    )


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of `large`, with the plots of its first task."""
    made = large()
    rows = build_rows(made.records, np.random.default_rng(0), resamples=200)
    first = [row for row in rows if row.task == rows[0].task]
    records = [record for record in made.records if record.entry.task == rows[0].task]
    scores = all_scores(records, ("mpc",), np.random.default_rng(0))
    part = replace(made, records=records)
    plots = make_plots(part, first, scores, np.random.default_rng(0))
    text = to_html(made, rows, {row.task: plots.get(row.task, []) for row in rows}, scores)
    path = tmp_path_factory.mktemp("layout") / "report.html"
    path.write_text(text, encoding="utf-8")
    return path


def test_report(browser: Browser, report: Path) -> None:
    assert layout_faults(browser, report.as_uri()) == []


def test_report_of_one_policy_that_captures_nothing(browser: Browser, tmp_path: Path) -> None:
    record = make_record(captured=False, outcome="timeout", time_to_capture=None)
    made = EvaluationResult([record])
    rows = build_rows(made.records, np.random.default_rng(0), resamples=50)
    path = tmp_path / "report.html"
    path.write_text(to_html(made, rows, {rows[0].task: []}), encoding="utf-8")
    assert layout_faults(browser, path.as_uri()) == []


def test_a_leaderboard_uses_the_screen(browser: Browser, report: Path) -> None:
    page = browser.new_page(viewport={"width": 2560, "height": 1200}, reduced_motion="reduce")
    page.goto(report.as_uri())
    told = page.locator(".board + .more").first
    shown = page.evaluate("(() => { const b = document.querySelector('.board'); return b.clientWidth; })()")
    assert shown == page.evaluate("document.querySelector('.board').scrollWidth") and not told.is_visible()
    page.set_viewport_size({"width": 1000, "height": 900})
    until(page, "!document.querySelector('.board + .more').hidden")
    assert page.evaluate("document.querySelector('.board').clientWidth") > 950
    page.close()


def test_a_table_that_is_cut_says_so_and_keeps_its_names(browser: Browser, report: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 800}, reduced_motion="reduce")
    page.goto(report.as_uri())
    board, told = page.locator(".board").first, page.locator(".board + .more").first
    columns = board.locator("thead th").count()
    until(page, "/[0-9]+ more columns/.test(document.querySelector('.board + .more').textContent)")
    assert columns / 2 < int(told.inner_text().split()[0]) < columns
    board.evaluate("box => box.scrollTo(box.scrollWidth, 0)")
    until(page, "document.querySelector('.board + .more').classList.contains('end')")
    name = board.locator("tbody th").first.bounding_box()
    frame = board.bounding_box()
    assert name and frame and name["x"] == pytest.approx(frame["x"], abs=2) and name["width"] < 0.45 * 390
    assert not told.is_visible()
    page.close()


def test_everything_of_a_plot_and_every_tab_is_on_a_phone(browser: Browser, report: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 800}, reduced_motion="reduce")
    page.goto(report.as_uri())
    outside = """(all) => all.filter((each) => {
        const box = each.getBoundingClientRect();
        return box.width && (box.left < -0.5 || box.right > 390.5);
    }).map((each) => each.textContent)"""
    assert page.locator("nav.tabs a").count() == len(ENTRIES) + 1
    assert page.locator("nav.tabs a").evaluate_all(outside) == []
    texts = page.locator(".plots svg text")
    assert texts.count() > 500 and texts.evaluate_all(outside) == []
    sizes = texts.evaluate_all("""(all) => all.map((each) => {
        const scale = each.getScreenCTM();
        return parseFloat(getComputedStyle(each).fontSize) * Math.hypot(scale.a, scale.b);
    })""")
    assert min(sizes) > 4.5 and np.quantile(sizes, 0.5) > 7.0
    page.close()


# The check of a robot


def test_check_of_a_robot(browser: Browser, tmp_path: Path) -> None:
    robot = replace(find_robot("shyam2020"), name=HOSTILE, notes=("a note about joint_7. " * 20,))
    figures = robot_figures(robot)
    findings = implausible(figures)
    assert len(findings) > 5
    planners = [
        PlannerFigures(
            name, "joint_velocity", 20, reached, reached / 20, 4.2, np.nan, "no_plan: " + "words " * 12
        )
        for name, reached in (("promp_optimal_kept", 20), ("my_package.planners:Planner", 0))
    ]
    tests = [Verification("momentum, joint_velocity", passed, "3e-08") for passed in (True, False, None)]
    tables = [*figure_tables(figures), verification_table(tests), planner_table(planners, "validation")]
    pictures = [RobotPicture(title, make_picture(0.5)) for title in ("At home", "Stretched")]
    path = tmp_path / "check.html"
    write_robot_page(RobotReport(figures, findings, tables, pictures, "", "python -m x " * 20), path)
    assert layout_faults(browser, path.as_uri()) == []
    assert HOSTILE not in path.read_text()


# Pages of the papers


def wave(axes: Axes) -> None:
    t = np.linspace(0.0, 20.0, 50)
    axes.plot(t, np.sin(t), label="joint 1")
    axes.set(xlabel="time [s]", ylabel="joint velocity [rad/s]")
    axes.legend()


def words(title: str, panels: int) -> dict[str, object]:
    """Text of a figure."""
    return {"title": title, "caption": "A caption.", "alt": ["A wave."] * panels}


def movie() -> Movie:
    """Two robots with two links an arm that wave."""
    t = np.linspace(0.0, 1.0, 5)
    chains = [
        Chain(np.array([0.5, side]), (1.0, 0.7), np.stack([side * t, t], axis=1), color)
        for side, color in ((0.3, "#0072b2"), (-0.3, "#d55e00"))
    ]
    trails = [np.stack([t, t], axis=1), np.stack([t, -t], axis=1)]
    grapples = np.array([[0.0, 0.3], [0.0, -0.3]])
    scenes = [
        AnimatedRobot(
            title, np.zeros((5, 2)), t, chains, np.ones(2), t, grapples, trails, t, 1.0, "C = 0.7505 J s"
        )
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
                (movie(), Picture("poses", "Poses", "Four.", "An arm.", jpeg), Prose(("Words. " * 60,))),
            ),
            Section(
                "Claims and what came of each of them", (ClaimTable(claims, "on its own case", "goals"),)
            ),
            Section(
                "Figures and tables",
                (
                    figure("one", words("One panel", 1), [wave]),
                    figure("many", words("Many panels", 6), [wave] * 6),
                    Table("Wide", (heads[0], *heads[1:] * 4), rows, "A caption.", colors=("#0072b2",) * 2),
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
