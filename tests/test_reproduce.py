"""Pages of the papers: random cases that resume, claims, what is measured, and the page itself."""

import re
import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from xml.etree import ElementTree

import numpy as np
import pytest
from jinja2 import UndefinedError
from matplotlib.axes import Axes
from page_reader import check_self_contained

from reproduce.__main__ import command_of, main, parser
from reproduce.cases import read_cases, run_cases, source_digest
from reproduce.claims import Rule, count, rules, settle
from reproduce.page.animation import AnimatedRobot, Chain, animate
from reproduce.page.blocks import ClaimTable, Page, Prose, Section, Table
from reproduce.page.csv_tables import table_csv
from reproduce.page.figures import figure, standalone
from reproduce.page.text import PageText
from reproduce.page.writing import to_html, to_markdown, write_docs
from space_envs.errors import ConfigurationError

HOSTILE = '<script>alert(1)</script> & $x_1$ | `a` [b](http://c) "q"'


# Random cases


def squares(index: int, offset: int = 0) -> dict:
    return {"index": index, "value": index**2 + offset}


def refuse(index: int) -> dict:
    raise AssertionError(f"case {index} was worked out again")


def test_cases_resume(tmp_path):
    path = tmp_path / "deep" / "cases.jsonl"
    first = run_cases(squares, 3, path)
    assert [each["value"] for each in first] == [0, 1, 4]
    assert run_cases(refuse, 3, path) == first
    assert run_cases(squares, 5, path)[3:] == [squares(3), squares(4)]
    assert run_cases(refuse, 2, path) == first[:2]


def test_half_written_lines_are_worked_out_again_and_spoil_no_other(tmp_path):
    path = tmp_path / "cases.jsonl"
    run_cases(squares, 3, path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    assert set(read_cases(path)) == {0, 1}
    assert [each["value"] for each in run_cases(squares, 3, path)] == [0, 1, 4]
    assert set(read_cases(path)) == {0, 1, 2}
    path.write_bytes(b'\xff\xfe\n{"index": "0"}\n[1]\n{"index": true}\n' + whole)
    assert set(read_cases(path)) == {0, 1, 2}


def test_a_case_that_is_interrupted_keeps_those_before(tmp_path):
    path = tmp_path / "cases.jsonl"

    def work(index: int) -> dict:
        if index == 2:
            raise KeyboardInterrupt
        return squares(index)

    with pytest.raises(KeyboardInterrupt):
        run_cases(work, 4, path)
    assert set(read_cases(path)) == {0, 1}


def test_results_do_not_depend_on_jobs(tmp_path):
    one = run_cases(partial(squares, offset=7), 5, tmp_path / "one.jsonl", jobs=1)
    two = run_cases(partial(squares, offset=7), 5, tmp_path / "two.jsonl", jobs=2)
    assert one == two


@pytest.mark.parametrize(("cases", "jobs"), [(0, 1), (1, 0), (True, 1), (2.0, 1)])
def test_counts_are_checked(tmp_path, cases, jobs):
    with pytest.raises(ConfigurationError, match="positive integer"):
        run_cases(squares, cases, tmp_path / "cases.jsonl", jobs)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot write to"):
        run_cases(squares, 1, tmp_path / "file" / "cases.jsonl")


def test_keys_change_with_settings_and_sources(tmp_path):
    (tmp_path / "one.py").write_text("x = 1\n")
    before = source_digest([tmp_path])
    assert source_digest([tmp_path]) == before
    (tmp_path / "one.py").write_text("x = 2\n")
    assert source_digest([tmp_path]) != before


# Claims


def rule(test=None, key: str = "key") -> Rule:
    return Rule(key, "III", "says", "counted", lambda record: f"x = {record['x']}", test)


def test_shares_leave_out_what_cannot_be_asked():
    records = [{"x": value} for value in (1, 2, 3, None)]
    share = count(lambda record: None if record["x"] is None else record["x"] > 1, records)
    assert (share.holds, share.of, share.left_out) == (2, 3, 1)
    assert str(share) == "2 of 3 (67 %, 21 to 94 %)"
    nothing = count(lambda record: None, records)
    assert (nothing.of, nothing.left_out, str(nothing), nothing.interval) == (0, 4, "no case", "")


def test_claims_are_settled_by_one_rule_for_all():
    rules = [rule(lambda record: record["x"] > 1), rule(), rule(lambda record: None)]
    claims = settle(rules, {"x": 0}, [{"x": 1}, {"x": 2}])
    assert [claim.verdict for claim in claims] == ["does not hold", "not decided", "not decided"]
    assert claims[0].measured == "x = 0"
    assert claims[0].share and claims[0].share.holds == 1
    assert claims[1].share is None


def test_claims_get_the_tests_of_their_names_and_sentences_from_the_text():
    entry = {"key": "large", "where": "III", "says": "x is large.", "counted": "At least {{ LEAST }}."}
    claims = [entry | {"measured": "x = {{ x | fmt('.1f') }}"}, entry | {"key": "other", "measured": "-"}]
    text = PageText({"claims": claims}, {"LEAST": 2})

    def large(record: Mapping) -> bool:
        return record["x"] >= 2

    def lost(record: Mapping) -> bool:
        return True

    first, second = rules(text, "claims", [large], lambda record: record)
    assert (first.counted, first.measured({"x": 3}), first.remark) == ("At least 2.", "x = 3.0", "")
    assert first.test is large and second.test is None
    with pytest.raises(ValueError, match="without a claim in 'claims': lost"):
        rules(text, "claims", [large, lost], lambda record: record)


def test_text_is_paragraphs_and_points_with_single_spaces():
    run = "\n  One {{ n }}\n  line.\n\n  Two.\n\n  - A\n    point.\n  - Another.\n"
    text = PageText({"texts": {"run": run}}, {})
    assert text.paragraphs("texts.run", n=1) == (("One 1 line.", "Two."), ("A point.", "Another."))
    with pytest.raises(UndefinedError, match="'n' is undefined"):
        text.paragraphs("texts.run")
    with pytest.raises(KeyError):
        text.fill("texts.ran")


# Figures and animation


def line(axes: Axes) -> None:
    axes.plot([0, 1], [0, 1])


def test_a_figure_is_panels_and_a_file():
    text = {"title": "title", "caption": "caption", "alt": [f"p{number}." for number in range(4)]}
    made = figure("fig", text, [line] * 4)
    assert len(made.panels) == 4 and made.alt == "p0. p1. p2. p3."
    root = ElementTree.fromstring(made.file.encode())
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "prefers-color-scheme: dark" in made.file
    assert figure("fig", text, [line] * 4) == made
    with pytest.raises(ValueError, match="not an svg"):
        standalone("<p></p>")


def transforms(element: ElementTree.Element, frame: int) -> np.ndarray:
    """The element's transform at a frame, as a 3 by 3 matrix."""
    matrix = np.eye(3)
    for kind, numbers in re.findall(r"(\w+)\(([^)]*)\)", element.get("transform", "")):
        matrix = matrix @ transform(kind, [float(word) for word in numbers.split()])
    for child in element:
        if child.tag.endswith("animateTransform"):
            values = child.get("values", "").split(";")[frame]
            matrix = matrix @ transform(child.get("type", ""), [float(word) for word in values.split()])
    return matrix


def transform(kind: str, numbers: list[float]) -> np.ndarray:
    matrix = np.eye(3)
    if kind == "translate":
        matrix[:2, 2] = numbers
    elif kind == "scale":
        matrix[0, 0], matrix[1, 1] = numbers
    else:
        c, s = np.cos(np.deg2rad(numbers[0])), np.sin(np.deg2rad(numbers[0]))
        matrix[:2, :2] = [[c, -s], [s, c]]
    return matrix


def tip_places(element: ElementTree.Element, frame: int, within: np.ndarray, radius: str) -> list[np.ndarray]:
    within = within @ transforms(element, frame)
    found = [within[:2, 2]] if element.tag.endswith("circle") and element.get("r") == radius else []
    for child in element:
        found += tip_places(child, frame, within, radius)
    return found


def test_the_animation_moves_the_arms_as_planned():
    rng = np.random.default_rng(1)
    angles, base = rng.uniform(-2, 2, (2, 4, 3)), rng.uniform(-0.2, 0.2, (4, 2))
    turn, mounts, lengths = rng.uniform(-1, 1, 4), rng.uniform(-0.5, 0.5, (2, 2)), (1.0, 0.7, 0.5)
    expected = np.zeros((4, 2, 2))
    for arm in range(2):
        heading = turn[:, None] + np.cumsum(angles[arm], axis=1)
        along = np.stack([np.cos(heading), np.sin(heading)], axis=-1) * np.array(lengths)[:, None]
        c, s = np.cos(turn), np.sin(turn)
        mount = np.stack(
            [c * mounts[arm, 0] - s * mounts[arm, 1], s * mounts[arm, 0] + c * mounts[arm, 1]], 1
        )
        expected[:, arm] = base + mount + along.sum(axis=1)
    scene = AnimatedRobot(
        HOSTILE, base, turn, [Chain(mounts[arm], lengths, angles[arm], "#123456") for arm in range(2)],
        np.zeros(2), np.zeros(4), np.array([[0.0, -0.3], [0.0, 0.3]]), [expected[:, arm] for arm in range(2)],
        np.linspace(0, 1, 4), 2.0, HOSTILE,
    )  # fmt: skip
    svg, seconds = animate([scene], duration=3.0, box=(-1.0, -2.0, 3.0, 2.0))
    root = ElementTree.fromstring(svg)
    assert "<script" not in svg
    scale = next(e for e in root.iter() if "scale" in e.get("transform", ""))
    metres = np.linalg.inv(transforms(root[0], 0) @ transforms(scale, 0))
    for frame in (0, 2, 3):
        found = [(metres @ [*place, 1.0])[:2] for place in tip_places(root, frame, np.eye(3), "0.05")]
        np.testing.assert_allclose(found, expected[frame], atol=2e-3)
    for each in root.iter():
        if each.get("keyTimes"):
            times = [float(word) for word in each.get("keyTimes", "").split(";")]
            assert times[0] == 0 and times[-1] == 1 and times == sorted(times)
            assert len(times) == len(each.get("values", "").split(";")) == 5
            assert each.get("dur") == f"{seconds:g}s"


# The page


@pytest.fixture(scope="module")
def page() -> Page:
    claim = Rule("key", HOSTILE, HOSTILE, HOSTILE, lambda record: HOSTILE, lambda record: True, HOSTILE)
    drawn = figure("one", {"title": HOSTILE, "caption": HOSTILE, "alt": [HOSTILE]}, [line])
    return Page(
        name="paper",
        title=HOSTILE,
        lead=(HOSTILE,),
        notice=HOSTILE,
        chips=((HOSTILE, HOSTILE),),
        tiles=((HOSTILE, HOSTILE, HOSTILE, HOSTILE),),
        sections=(
            Section("First", (Prose((HOSTILE,), (HOSTILE,)), drawn)),
            Section("Second", (Table(HOSTILE, ("a", HOSTILE), ((HOSTILE, "1"),), HOSTILE),)),
            Section("Third", (ClaimTable(tuple(settle([claim], {}, [{}])), HOSTILE, HOSTILE),)),
        ),
        command="python -m reproduce paper",
        provenance={"versions": {"numpy": HOSTILE}, "list": [1, 2]},
        files={"numbers.csv": ("Numbers", "a,b\n")},
    )


def test_the_page_needs_nothing_outside_and_escapes(page):
    reader = check_self_contained(to_html(page))
    assert sum(HOSTILE in text for text in reader.text) >= 12
    assert {"first", "second", "third", "provenance"} <= set(reader.ids)


def test_markdown_escapes(page):
    text = to_markdown(page, "figures")
    assert "<script>" not in text and "](http:" not in text and "$x" not in text.replace("\\$", "")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows if "counted" not in row} <= {3, 7}
    assert "](figures/one.svg)" in text


def test_documentation_is_the_page_with_its_figures(page, tmp_path):
    path = write_docs(page, tmp_path)
    text = path.read_text(encoding="utf-8")
    assert "## Second" in text and "## Third" in text
    (link,) = re.findall(r"\]\((images/\S+)\)", text)
    ElementTree.parse(tmp_path / link)


def test_csv_keeps_all_digits_and_starts_no_formula():
    assert table_csv(("a", "b"), [(0.1 + 0.2, "=1+1"), (None, 3)]) == "a,b\n0.30000000000000004,'=1+1\n,3\n"


# The command


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["shah2031"], "Did you mean 'shah2013'?"),
        (["shah2013", "--cases", "0"], "cases must be at least 1, got 0"),
        (["shah2013", "--seed", "-1"], "seed must be at least 0"),
        (["shah2013", "--jobs", "0"], "jobs must be at least 1"),
        (["shah2013", "--docs", "nowhere"], "must name a folder that is there"),
    ],
)
def test_options_are_checked_before_anything_runs(arguments, said, capsys):
    assert main(arguments) == 2
    assert said in capsys.readouterr().err


def test_a_folder_that_is_a_file_is_told_at_once(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["shah2013", "--output", str(tmp_path / "file")]) == 2
    assert "is a file; expected a folder to write to" in capsys.readouterr().err


def test_an_interrupt_is_told_in_one_line(monkeypatch, capsys, tmp_path):
    def stop(options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("reproduce.shah2013.reproduce", stop)
    assert main(["shah2013", "--output", str(tmp_path)]) == 130
    assert "the same command goes on" in capsys.readouterr().err


def test_help_runs_as_a_module():
    found = subprocess.run(
        [sys.executable, "-m", "reproduce", "--help"], capture_output=True, text=True, check=True, timeout=60
    )
    assert "shah2013" in found.stdout and "--docs" in found.stdout


def test_a_page_shows_what_determines_it_and_no_folder():
    words = [
        "shyam2020",
        "--cases",
        "3",
        "--seed",
        "4",
        "--output",
        "/somewhere",
        "--docs",
        "docs",
        "--jobs",
        "1",
    ]
    shown = command_of(parser().parse_args(words))
    assert shown == "python -m reproduce shyam2020 --cases 3 --seed 4"
    assert command_of(parser().parse_args(["shah2013", "--quick"])) == "python -m reproduce shah2013 --quick"
