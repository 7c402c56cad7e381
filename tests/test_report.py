"""Leaderboard rows, tables, figures and the report's folder."""

import base64
import csv
import dataclasses
import hashlib
import io
import itertools
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from rich.console import Console
from synthetic_results import (
    CHARACTERS,
    HOSTILE,
    Character,
    entry,
    failed,
    make_record,
    make_result,
    rows_of,
    timed,
    untimed,
)

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.columns import COLUMNS, RULES
from space_envs.evaluation.leaderboard.figures import FIGURES
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.causes import CAUSES
from space_envs.evaluation.play.episode_file import load_episodes
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.names import csv_name, display_name, file_name, latex_name, markdown_name
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.replay.stills import Still
from space_envs.evaluation.report.drawing.look import PALETTE, make_looks
from space_envs.evaluation.report.drawing.panel import Panel
from space_envs.evaluation.report.folder import ReportPaths, write_report
from space_envs.evaluation.report.page.html import SCRIPTS, to_html
from space_envs.evaluation.report.page.pictures import NO_PICTURES, NONE_HERE, NOTHING_CAPTURED, TOO_MANY
from space_envs.evaluation.report.page.scores import all_scores
from space_envs.evaluation.report.page.section import highlights
from space_envs.evaluation.report.plots.all_plots import make_plots
from space_envs.evaluation.report.plots.disturbance import cost_plot
from space_envs.evaluation.report.plots.intervals import intervals_plot, scores_plot
from space_envs.evaluation.report.plots.motion import attitude_plot, motion_plot, representative_episode
from space_envs.evaluation.report.plots.outcomes import outcomes_plot
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.csv_file import to_csv
from space_envs.evaluation.report.tables.latex import to_latex
from space_envs.evaluation.report.tables.markdown import to_markdown
from space_envs.evaluation.report.tables.terminal import to_terminal
from space_envs.evaluation.report.templating import breakable
from space_envs.evaluation.results.result import EvaluationResult, entry_stem

WICKED = "$x_$ | `a` *b* [c](http://d) & é\x1b[31m\n<script>alert(1)</script>"


def named(result: EvaluationResult) -> dict[str, EpisodeBatch]:
    return {each.policy: own for each, own in result.episodes.items()}


@pytest.fixture(scope="module")
def result() -> EvaluationResult:
    odd = {HOSTILE: CHARACTERS["bc"], WICKED: CHARACTERS["ppo"]}
    return make_result(pictures=True, extra=odd, policies=("hold", "minimum_jerk", "gjm", "mpc", "promp"))


@pytest.fixture(scope="module")
def rows(result: EvaluationResult) -> list[Row]:
    return build_rows(result.records, np.random.default_rng(0))


@pytest.fixture(scope="module")
def paths(result: EvaluationResult, tmp_path_factory: pytest.TempPathFactory) -> ReportPaths:
    return write_report(result, tmp_path_factory.mktemp("report") / "new")


# Tables


def test_terminal_table_in_a_pipe_has_all_columns_and_no_colors(rows: list[Row]) -> None:
    file = io.StringIO()
    to_terminal(rows, Console(file=file))
    text = file.getvalue()
    assert "\x1b" not in text and "…" not in text
    for column in COLUMNS:
        assert all(word in text for word in column.title.split())
    (line,) = (line for line in text.splitlines() if re.match(r"\s+\d\s+mpc ", line))
    assert re.match(r"\s+\d\s+mpc\s+model\s+0\.\d+ \[0\.\d+, 0\.\d+\]\s+100 \[93, 100\]\s+\d+\s", line)
    assert HOSTILE in text


@pytest.mark.parametrize("width", [60, 80, 120, 300])
def test_terminal_table_fits_its_terminal(rows: list[Row], width: int) -> None:
    file = io.StringIO()
    to_terminal(rows, Console(file=file, force_terminal=True, color_system="standard", width=width))
    text = file.getvalue()
    assert "\x1b[" in text
    lines = re.sub(r"\x1b\[[0-9;]*m", "", text).splitlines()
    assert max(map(len, lines)) <= width
    assert any(re.search(r"\d\s+mpc\s+(model\s+)?0\.\d+ \[", line) for line in lines)
    assert ("Not shown at this width" in text) == (width < 300)


def test_terminal_table_in_ascii(rows: list[Row]) -> None:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding="ascii")
    to_terminal(rows, Console(file=file))
    file.flush()
    assert b"mpc" in raw.getvalue()


def test_markdown_is_a_table_whatever_the_names(rows: list[Row]) -> None:
    text = to_markdown(rows)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(rows)
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {len(COLUMNS) + 3}
    assert lines[0].startswith("| rank | policy | knowledge | kept-attitude score | success [%] |")
    assert "<" not in text and "minimum_jerk" in text and "&lt;img src=x" in text
    assert re.search(r"\| \d \| mpc \| model \| 0\.\d+ \[0\.\d+, 0\.\d+\] \| 100 \[93, 100\] \|", text)


def test_csv_has_every_figure_with_its_interval(rows: list[Row]) -> None:
    table = list(csv.DictReader(io.StringIO(to_csv(rows))))
    assert [line["policy"] for line in table] == [csv_name(row.policy) for row in rows]
    for line, row in zip(table, rows, strict=True):
        for key in FIGURES:
            for suffix, value in (
                ("", row.figures[key].value),
                ("_low", row.figures[key].low),
                ("_high", row.figures[key].high),
            ):
                assert line[key + suffix] == (repr(value) if math.isfinite(value) else "")
        assert line["rank"] == ("" if row.rank is None else str(row.rank))
        assert int(line["captures"]) == row.captures
        assert sum(int(line[f"cause_{cause}"]) for cause in CAUSES) == row.episodes - row.captures
    assert table[-1]["time_to_capture"] == ""


def test_latex_is_a_table_whatever_the_names(rows: list[Row]) -> None:
    text = to_latex(rows)
    body = text[text.index(r"\midrule") : text.index(r"\bottomrule")].splitlines()[1:-1]
    assert len(body) == len(rows)
    for line in body:
        assert len(re.findall(r"(?<!\\)&", line)) == 9 and line.endswith(r" \\")
        # No character of a name is left that means something to LaTeX.
        name = re.sub(r"\\(text\w+\{\}|[#$%&_{}])|\{[\[\]]\}|-\{\}-", "", line.split(" & ")[1])
        assert not re.search(r"[\\#$%&_{}~^<>|\"]", name), line
    (mpc,) = (line for line in body if " & mpc & " in line)
    assert re.search(r"& \\textbf\{100\} \{\\footnotesize \{\[\}93, 100\{\]\}\} &", mpc)
    (hold,) = (line for line in body if line.strip().startswith("- & hold "))
    assert "textbf" not in hold  # it keeps its attitude by doing nothing
    assert latex_name("a_b~c\\d") == r"a\_b\textasciitilde{}c\textbackslash{}d"


def test_files_of_entries_never_share_a_name() -> None:
    records = [
        make_record(policy=policy, control_mode=mode, difficulty=difficulty)
        for policy in ("a", "A", "a-b", "x" * 200, "../..", HOSTILE)
        for mode in ("joint_velocity", "b-joint_velocity")
        for difficulty in ("easy", "hard")
    ]
    stems = [entry_stem(record.entry) for record in records]
    assert len({stem.lower() for stem in stems}) == len(records)
    assert all(re.fullmatch(r"[a-z0-9_-]{1,80}\.[0-9a-f]{12}", stem) for stem in stems)


def test_one_episode_is_no_plural_and_names_break_after_punctuation_only() -> None:
    row, *_ = rows_of([make_record()])
    assert ">1</b> episode each" in to_html(EvaluationResult([make_record()]), [row], {row.task: []})
    assert breakable("kept@0.1deg") == "kept@<wbr>0.1deg"
    assert breakable("a_b.c:D") == "a_<wbr>b.<wbr>c:<wbr>D"


def test_names_are_made_harmless() -> None:
    assert csv_name("=1+1") == "'=1+1"
    assert csv_name("mpc") == "mpc"
    assert display_name("a\nb\x00\u202ec") == "a\ufffdb\ufffd\ufffdc"
    assert len(display_name("x" * 1000)) == 60
    assert markdown_name("minimum_jerk") == "minimum_jerk"
    assert markdown_name("a|b_*") == r"a\|b\_\*"
    names = ["mpc", "MPC", "Mpc", "a/b", "a:b", "../../etc/passwd", "..", "", "\ud800", "con.", "package.m:C"]
    names.append("x" * 300)
    stems = [file_name(name) for name in names]
    assert stems[0] == "mpc" and len({stem.lower() for stem in stems}) == len(names)
    assert all(
        re.fullmatch(r"[a-z0-9][a-z0-9_-]*(\.[0-9a-f]{12})?", stem) and len(stem) < 64 for stem in stems
    )


# Figures


def test_figures_are_xml_with_names_as_text(result: EvaluationResult, rows: list[Row]) -> None:
    looks = make_looks([row.policy for row in rows])
    plots = [
        intervals_plot(rows, looks),
        outcomes_plot(rows),
        cost_plot(rows, looks),
        attitude_plot(named(result), looks),
        motion_plot(named(result)),
    ]
    seen = set()
    for plot in plots:
        assert plot and plot.panels
        for panel in plot.panels:
            root = ElementTree.fromstring(panel.svg)
            assert "width" not in root.attrib and "viewBox" in root.attrib
            assert "#010203" not in panel.svg and "currentColor" in panel.svg
            names = {element.tag.split("}")[-1] for element in root.iter()}
            assert "script" not in names and "img" not in names and "image" not in names
            seen |= {"".join(element.itertext()) for element in root.iter() if element.tag.endswith("text")}
            defined = set(re.findall(r'\bid="([^"]+)"', panel.svg))
            used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', panel.svg))
            assert used and used <= defined
    assert {"mpc", "minimum_jerk", "<img src=x onerro...", "time [s]"} <= seen


def test_normalised_scores_are_drawn_where_both_references_were_played() -> None:
    made = make_result()
    rows = rows_of(list(made.records))
    looks = make_looks([row.policy for row in rows])
    scores = all_scores(made.records, ("mpc",), np.random.default_rng(0))
    plot = scores_plot(rows, scores, looks)
    assert plot is not None
    assert {panel.key for panel in plot.panels} >= {"scores-success", "scores-final_attitude"}
    alt = {panel.key: panel.alt for panel in plot.panels}
    assert "random 0" in alt["scores-success"] and "mpc 1" in alt["scores-success"]
    gjm = scores[entry("gjm")]["success"].estimate
    assert gjm is not None and f"gjm {gjm.value:.3g}" in alt["scores-success"]
    without = [record for record in made.records if record.policy != "random"]
    left = [row for row in rows if row.policy != "random"]
    assert scores_plot(left, all_scores(without, ("mpc",), np.random.default_rng(0)), looks) is None


def test_figures_repeat_whatever_the_users_style(rows: list[Row]) -> None:
    looks = make_looks([row.policy for row in rows])
    first = cost_plot(rows, looks)
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 30, "svg.fonttype": "path"}):
        assert cost_plot(rows, looks) == first
        assert matplotlib.rcParams["font.size"] == 30
    assert dict(matplotlib.rcParams) == before


def test_figures_without_data() -> None:
    rows = rows_of([failed(attitude_cost=0.0)])
    look = make_looks(["mpc", "hold"])
    assert cost_plot(rows, look) is None
    assert attitude_plot({}, {}) is None
    assert motion_plot({}) is None
    still = named(make_result(episodes=1))["hold"]
    assert motion_plot({"hold": still}) is None
    assert attitude_plot({"hold": still}, look)


def test_representative_episode_is_the_middle_one(result: EvaluationResult) -> None:
    attitude = np.array([3.0, 1.0, 2.0, 9.0, 8.0])[:, None] * np.ones(201)
    made = dataclasses.replace(named(result)["mpc"].take(range(5)), attitude=attitude)
    assert representative_episode({"a": made, "b": made}) == 0


def test_no_two_policies_look_the_same() -> None:
    made = make_looks([f"policy_{number}" for number in range(36)])
    assert len({(look.color, look.marker) for look in made.values()}) == 36
    assert len({(look.color, str(look.dash)) for look in made.values()}) == 36
    assert len({look.color for look in list(made.values())[:18]}) == 18
    points = oklab(np.array([to_rgb(color) for color in PALETTE]))
    apart = np.linalg.norm(points[:, None] - points, axis=-1) + np.eye(len(points))
    assert apart.min() > 0.09


def oklab(rgb: np.ndarray) -> np.ndarray:
    """Colors (n, 3) of sRGB in a space in which distances are as they are seen (Ottosson 2020)."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_lms = [[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]]
    to_lab = [[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]]
    return np.cbrt(linear @ np.array(to_lms).T) @ np.array(to_lab).T


@pytest.fixture(scope="module")
def reactionless() -> EvaluationResult:
    """Policies whose attitudes differ by six powers of ten, as on the dual-arm tasks."""
    extra = {
        "reactionless_free": Character(1.0, 2e-5, 4e-6, 2e-5, 19.7, 218.0, 0.33),
        "reactionless_rate": Character(0.99, 1e-4, 4e-5, 8e-5, 11.2, None, 1.2),
        "bc": Character(1.0, 0.19, 0.06, 9e-5, 11.4, None, 0.15),
    }
    return make_result(episodes=20, policies=("hold", "random"), extra=extra)


@pytest.fixture(scope="module")
def drawn(reactionless: EvaluationResult) -> dict[str, Plot]:
    rows = rows_of(list(reactionless.records))
    generator = np.random.default_rng(0)
    scores = all_scores(reactionless.records, ("reactionless_free",), generator)
    ((_, plots),) = make_plots(reactionless, rows, scores, generator).items()
    return {plot.key: plot for plot in plots}


def test_labels_of_axes_do_not_touch(drawn: dict[str, Plot]) -> None:
    assert set(drawn) >= {"intervals", "scores", "profiles", "pareto", "cost", "attitude"}
    for plot in drawn.values():
        for panel in plot.panels:
            assert panel.figure
            for axes in panel.figure.axes:
                for axis in (axes.xaxis, axes.yaxis):
                    low, high = sorted(axis.get_view_interval())
                    labels = [
                        label.get_window_extent()
                        for tick in axis.get_major_ticks()
                        for label in (tick.label1, tick.label2)
                        if low <= tick.get_loc() <= high and label.get_visible() and label.get_text()
                    ]
                    assert len(labels) >= 2 or not axis.get_label_text(), (panel.key, axis.axis_name)
                    for one, other in itertools.combinations(labels, 2):
                        assert not one.overlaps(other), (panel.key, axis.axis_name)


def test_attitudes_that_are_almost_kept_do_not_lie_on_zero(drawn: dict[str, Plot]) -> None:
    ends = {}
    for panel in drawn["attitude"].panels:
        assert panel.figure
        (axes,) = panel.figure.axes
        points = axes.transData.transform(np.asarray(axes.lines[-1].get_xydata()))
        ends[axes.get_title(loc="left")] = axes.transAxes.inverted().transform(points)[-1, 1]
    assert ends["hold"] == pytest.approx(0.0, abs=1e-9)
    assert 0.05 < ends["reactionless_free"] < ends["reactionless_rate"] - 0.05 < ends["bc"] - 0.1
    assert ends["random"] <= 1.0 and "logarithmic" in drawn["attitude"].caption


def test_attitudes_of_one_size_are_drawn_on_a_linear_scale(result: EvaluationResult) -> None:
    calm = {name: named(result)[name] for name in ("mpc", "gjm", "promp")}
    plot = attitude_plot(calm, make_looks(list(calm)))
    assert plot and "logarithmic" not in plot.caption
    assert all(panel.figure and panel.figure.axes[0].get_yscale() == "linear" for panel in plot.panels)


# Report


class Page(HTMLParser):
    """Collects what a browser would act on, and that elements are closed in order."""

    VOID = {"meta", "link", "img", "br", "input", "wbr"}

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len(dict(attrs)) == len(attrs), tag
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def named(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def page(paths: ReportPaths) -> Page:
    return Page(paths.html.read_text(encoding="utf-8"))


def test_report_writes_what_can_be_read_back(result: EvaluationResult, paths: ReportPaths) -> None:
    assert read_records(paths.records) == list(result.records)
    summary = json.loads(paths.summary.read_text(encoding="utf-8"))
    assert summary["schema"] == 4 and summary["provenance"]["commit"] == "3f2c9d1"
    assert [row["rank"] for row in summary["rows"]] == [*range(1, len(result.episodes)), None]
    files = {row["policy"]: row["episodes"] for row in summary["rows"]}
    assert set(paths.episodes) == set(result.episodes) and len(set(files.values())) == len(files)
    for each, own in result.episodes.items():
        assert (paths.folder / files[each.policy]).samefile(paths.episodes[each])
        stored = load_episodes(paths.episodes[each])
        np.testing.assert_array_equal(stored.attitude, own.attitude.astype(np.float32))
    assert set(summary["checksums"]) == {"records.jsonl", *files.values()}
    for name, digest in summary["checksums"].items():
        assert hashlib.sha256((paths.folder / name).read_bytes()).hexdigest() == digest
    written = {
        path.relative_to(paths.folder).as_posix() for path in paths.folder.rglob("*") if path.is_file()
    }
    plots = {name for name in written if name.startswith("plots/")}
    assert written - plots == {
        *("records.jsonl", "summary.json", "leaderboard.md", "leaderboard.csv", "leaderboard.tex"),
        *("report.html", *files.values()),
    }
    assert {Path(name).suffix for name in plots} == {".svg", ".png"} and len(plots) > 30
    for name in plots:
        content = (paths.folder / name).read_bytes()
        if name.endswith(".svg"):
            root = ElementTree.fromstring(content)
            assert root.attrib["width"].endswith("in") and b"currentColor" not in content
        else:
            with Image.open(io.BytesIO(content)) as picture:
                shades = np.asarray(picture.convert("L"))
            assert min(shades.shape) > 200 and shades.max() == 255 and shades.min() < 100


def test_report_repeats_byte_for_byte_and_another_clock_changes_timing_only(
    paths: ReportPaths, tmp_path: Path
) -> None:
    assert paths.html.stat().st_size < 10_000_000
    few = make_result(10, 2, pictures=True, policies=(), extra={WICKED: CHARACTERS["ppo"]})
    slower = [dataclasses.replace(record, timing=timed(None, 99.0)) for record in few.records]
    again = make_result(10, 2, pictures=True, policies=(), extra={WICKED: CHARACTERS["ppo"]})
    first, second, other = (
        write_report(made, tmp_path / name)
        for name, made in (("a", few), ("b", again), ("c", dataclasses.replace(few, records=slower)))
    )
    files = {path.relative_to(first.folder) for path in first.folder.rglob("*")}
    assert files == {path.relative_to(second.folder) for path in second.folder.rglob("*")}
    for path in (name for name in files if (first.folder / name).is_file()):
        assert (first.folder / path).read_bytes() == (second.folder / path).read_bytes()
    assert untimed(read_records(other.records)) == untimed(few.records)
    summaries = [json.loads(path.summary.read_text(encoding="utf-8")) for path in (first, other)]
    assert summaries[0] != summaries[1]
    for summary in summaries:
        del summary["checksums"]["records.jsonl"]
        for row in summary["rows"]:
            del row["timing"]
    assert summaries[0] == summaries[1]


@pytest.mark.usefixtures("brief_reports")
def test_what_an_evaluation_before_left_is_removed(tmp_path: Path) -> None:
    write_report(make_result(episodes=4, policies=("mpc",)), tmp_path)
    mine = tmp_path / "episodes" / "notes.txt"
    mine.write_text("mine")
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "old.mp4").write_bytes(b"")
    left = write_report(make_result(episodes=4, policies=("gjm",)), tmp_path)
    assert {path for path in (tmp_path / "episodes").iterdir()} == {mine, *left.episodes.values()}
    assert not list((tmp_path / "videos").iterdir())


def test_page_asks_for_nothing_outside(paths: ReportPaths, page: Page) -> None:
    allowed = re.compile(r"data:|#|(records\.jsonl|summary\.json|leaderboard\.(md|csv|tex))$")
    for tag, attributes in page.tags:
        for name in ("src", "href", "xlink:href", "srcset", "data", "action", "poster"):
            if attributes.get(name) is not None and not (tag == "svg" or name.startswith("xmlns")):
                assert allowed.match(attributes[name] or ""), (tag, attributes)
    text = paths.html.read_text(encoding="utf-8")
    assert "@import" not in text and not re.search(r"url\((?!#)", text)
    (policy,) = (m["content"] for m in page.named("meta") if m.get("http-equiv") == "Content-Security-Policy")
    assert policy and "default-src 'none'" in policy and "img-src data:;" in policy
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert len(scripts) == len(SCRIPTS)
    assert " ".join(["script-src", *(f"'sha256-{digest}'" for digest in digests)]) + ";" in policy


def test_hostile_names_do_nothing(page: Page) -> None:
    assert [script.get("type") for script in page.named("script")] == [None] * len(SCRIPTS)
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), tag
    assert all((image["src"] or "").startswith("data:image/jpeg;base64,") for image in page.named("img"))
    assert HOSTILE in [text.strip() for text in page.texts]


def test_table_is_sortable_by_keyboard(page: Page, rows: list[Row]) -> None:
    assert all(button["type"] == "button" for button in page.named("button"))
    buttons = [button for button in page.named("button") if "data-first" in button]
    assert len(buttons) == len(COLUMNS) + 1
    better = ["ascending" if column.better == "lower" else "descending" for column in COLUMNS]
    assert [button["data-first"] for button in buttons[1:]] == better
    cells = [cell["data-sort"] for cell in page.named("td") if "data-sort" in cell]
    assert len(cells) == len(rows) * len(COLUMNS)
    # What a policy that never captures has no figure of sorts last: there is no number.
    titles = [column.key for column in COLUMNS]
    first, last = (dict(zip(titles, cells[start:], strict=False)) for start in (0, -len(COLUMNS)))
    assert (first["rank"], first["success"]) == ("1.0", repr(100 * rows[0].figures["success"].value))
    assert last["rank"] == last["time_to_capture"] == last["attitude_cost"] == ""


def test_page_shows_provenance_pictures_and_reasons(page: Page, result: EvaluationResult) -> None:
    texts = [text.strip() for text in page.texts]
    for expected in (
        result.provenance["command"],
        "mujoco",
        "made up, 1 thread",
        "4.0.0",
        "an x86-64 with 2 cores",
        "0, 1, 2, 3, 4",
    ):
        assert expected in texts
    assert "base turned by more than 45 deg" in texts
    assert "50 of 50: 33 timeouts, 17 attitude lost" in texts
    assert all(rule in texts for rule in RULES)
    assert len(page.named("img")) == 6
    assert {"0.0 s", "2.5 s", "12.5 s"} <= set(texts)  # below the stills
    assert page.named("img")[1]["alt"] == "mpc after 2.5 s"
    assert not any(NO_PICTURES[:30] in text for text in texts)


def test_page_says_why_there_are_no_pictures() -> None:
    result = dataclasses.replace(make_result(episodes=4, policies=("mpc",)), episodes={})
    rows = rows_of(list(result.records))
    assert NO_PICTURES in to_html(result, rows, {rows[0].task: []})
    noted = dataclasses.replace(result, pictures_note="No EGL <here>.")
    page = to_html(noted, rows, {rows[0].task: []})
    assert NO_PICTURES not in page and "No EGL &lt;here&gt;." in page


def test_room_for_pictures_is_shared_among_tasks(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (360, 480, 3), dtype=np.uint8)
    tasks = [
        (env_id, difficulty)
        for env_id in ("SpaceCapture/SingleArm-v0", "SpaceCapture/DualArmPlanar-v0")
        for difficulty in ("easy", "medium", "hard")
    ]
    records = [
        make_record(env_id=env_id, difficulty=difficulty, policy=policy)
        for env_id, difficulty in tasks
        for policy in ("a", "b", "c", "d")
    ]
    records.append(make_record(env_id="SpaceCapture/DualArmSpatial-v0"))
    records.append(failed(env_id="SpaceCapture/DualArmSpatial-v0", difficulty="hard"))
    rows = rows_of(records)
    stills = {row.entry: [Still(0.0, noise)] * 4 for row in rows if "Spatial" not in row.task.env_id}
    text = to_html(EvaluationResult(records, pictures=stills), rows, {row.task: [] for row in rows})
    assert len(text) < 2_000_000
    shown = [len(part.split("</section>")[0].split("<img")) - 1 for part in text.split('id="pictures-')[1:]]
    assert len(shown) == 8 and set(shown[:6]) == {shown[0]} and shown[0] % 4 == 0 and shown[0] > 0
    assert shown[6:] == [0, 0]
    assert NONE_HERE in text and NOTHING_CAPTURED in text
    assert NO_PICTURES not in text and TOO_MANY not in text
    # A page for which even the smallest are too large says so, and does not blame the machine.
    many = {row.entry: [Still(0.0, noise)] * 30 for row in rows}
    text = to_html(EvaluationResult(records, pictures=many), rows, {row.task: [] for row in rows})
    assert text.count(TOO_MANY) == 8 and "OpenGL" not in text and "<img" not in text


def test_room_for_plots_is_shared_among_tasks() -> None:
    records = [make_record(difficulty=difficulty) for difficulty in ("easy", "medium", "hard")]
    rows = rows_of(records)

    def plot(key: str, letters: int) -> Plot:
        return Plot(key, key.capitalize(), "", (Panel(f"<svg><!--{'x' * letters}--></svg>", key),))

    sizes = {"attitude": 900_000, "pareto": 1_100_000, "cost": 900_000}
    plots = {row.task: [plot(key, size) for key, size in sizes.items()] for row in rows}
    text = to_html(EvaluationResult(records), rows, plots)
    assert [text.count(f"<h4>{key.capitalize()}</h4>") for key in sizes] == [0, 3, 0]
    assert text.count("are in the folder plots/ only: attitude, cost.") == 3


def test_eq_20_has_one_name_and_one_unit(paths: ReportPaths, drawn: dict[str, Plot]) -> None:
    """On everything that people look at; records and leaderboard.csv keep SI units and names of fields."""
    text = paths.html.read_text(encoding="utf-8") + paths.markdown.read_text(encoding="utf-8")
    text += paths.latex.read_text(encoding="utf-8")
    text += "".join(panel.svg + panel.alt + plot.caption for plot in drawn.values() for panel in plot.panels)
    assert "base disturbance (eq. 20)" in text and "cm²/s" in text
    assert not re.search(r"attitude cost", text, re.IGNORECASE)
    assert not re.search(r"(?<![a-z])m(\^2|²)/s", text)


def test_page_of_several_tasks_has_unique_ids(tmp_path: Path) -> None:
    records = [
        make_record(difficulty=difficulty, policy=policy)
        for difficulty in ("easy", "hard")
        for policy in ("a", "b")
    ]
    text = write_report(EvaluationResult(records), tmp_path).html.read_text(encoding="utf-8")
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids)) > 50
    assert text.count('<table class="sortable">') == 2


def test_highlights_name_ties_and_only_able_policies() -> None:
    records = [
        make_record(policy="a", final_attitude=2.0),
        make_record(policy="b", final_attitude=2.0, attitude_cost=0.001),
        failed(policy="still", final_attitude=0.0, attitude_cost=0.0),
        make_record(policy="hold", final_attitude=0.0, peak_attitude=0.0, attitude_cost=0.0),
        *(make_record(policy="easy", final_attitude=0.1), failed(policy="easy", episode=1)),
    ]
    tiles = {tile["label"]: tile for tile in highlights(rows_of(records))}
    assert tiles["Highest kept-attitude score"]["names"] == "b, a"
    assert tiles["Most captures"]["names"] == tiles["Lowest final attitude error"]["names"] == "b, a"
    assert (tiles["Lowest final attitude error"]["value"], tiles["Least base disturbance"]["names"]) == (
        "2.0",
        "b",
    )
    assert [tile["label"] for tile in highlights(rows_of([failed()]))] == ["Most captures"]


def test_what_cannot_be_reported_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    result = make_result(episodes=2, policies=("mpc",))
    for bad, said in (
        (dataclasses.replace(result, records=[]), "at least one record"),
        (dataclasses.replace(result, provenance={"seed": np.int64(3)}), "plain JSON"),
        (dataclasses.replace(result, provenance={"rate": math.nan}), "plain JSON"),
        (
            dataclasses.replace(
                result, pictures={entry("mpc"): [Still(0.0, np.zeros((4, 4), dtype=np.uint8))]}
            ),
            "uint8",
        ),
    ):
        with pytest.raises(ConfigurationError, match=said):
            write_report(bad, tmp_path / "report")
    assert not (tmp_path / "report").exists()


def test_policies_that_plan_nothing_and_capture_nothing_are_shown(tmp_path: Path) -> None:
    lone = make_result(
        episodes=3, policies=(), extra={"nothing": Character(0.0, 0.0, 0.0, 0.0, 20, None, 0.0)}
    )
    written = write_report(lone, tmp_path)
    assert Page(written.html.read_text(encoding="utf-8")).named("table")
