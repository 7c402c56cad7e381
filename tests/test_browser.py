"""The report in a real headless Chromium: from disk, with mouse, keyboard and on a phone.

Debian's package `chromium` is what runs; without it nothing here can be tested.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from page_layout import CHROMIUM, until
from playwright.sync_api import Browser, Dialog, Locator, Page, Playwright
from synthetic_results import HOSTILE, changed, make_played, make_record, make_result

from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.replay.replay import Replay, make_replays
from space_envs.evaluation.report.page.html import to_html
from space_envs.evaluation.report.page.scores import all_scores
from space_envs.evaluation.report.plots.all_plots import make_plots
from space_envs.evaluation.results.result import EvaluationResult

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
PHONE = {
    "viewport": {"width": 375, "height": 740},
    "device_scale_factor": 2,
    "is_mobile": True,
    "has_touch": True,
}


def hostile(replays: tuple[Replay, ...]) -> tuple[Replay, ...]:
    """With an end that tries to leave its script element."""
    return tuple(replace(one, outcome="policy_error", reason=f"</script>{HOSTILE}") for one in replays)


def result() -> EvaluationResult:
    """Three policies on two tasks of one id, and a task of another; the first two have replays."""
    played = make_played("minimum_jerk", episodes=3)
    replays = make_replays(played.task, played.episodes, played.records)
    records: list[EpisodeRecord] = [*played.records]
    for number, (policy, attitude) in enumerate((("still", 0.0), (HOSTILE, 9.0))):
        records += [
            changed(
                record,
                policy=policy,
                final_attitude=attitude,
                peak_attitude=attitude,
                time_to_capture=20.0 - number,
            )
            for record in played.records
        ]
    for difficulty in ("hard", "easy"):
        records += [make_record(policy=policy, difficulty=difficulty) for policy in ("mpc", "still")]
    records.append(make_record(env_id="SpaceCapture/DualArmPlanar-v0"))
    whole = make_result(episodes=2, policies=("mpc",))
    return replace(
        whole,
        records=records,
        episodes={},
        replays={records[0].entry: replays, records[6].entry: hostile(replays)},
    )


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    made = result()
    rows = build_rows(made.records, np.random.default_rng(0))
    # Plots of one task are enough to look at.
    medium = replace(made, records=[record for record in made.records if record.difficulty == "medium"])
    scores = all_scores(medium.records, medium.experts, np.random.default_rng(0))
    plots = make_plots(
        medium, [row for row in rows if row.task.difficulty == "medium"], scores, np.random.default_rng(0)
    )
    path = tmp_path_factory.mktemp("browser") / "report.html"
    path.write_text(
        to_html(made, rows, {row.task: plots.get(row.task, []) for row in rows}), encoding="utf-8"
    )
    return path.as_uri()


@pytest.fixture
def complaints() -> list[str]:
    return []


@pytest.fixture
def page(
    browser: Browser, address: str, complaints: list[str], request: pytest.FixtureRequest
) -> Iterator[Page]:
    """The report, opened with a test's `options`; it must ask for nothing and complain about nothing."""
    mark = request.node.get_closest_marker("parametrize")
    options = request.node.callspec.params.get("options", {}) if mark else {}
    context = browser.new_context(
        **{"viewport": {"width": 760, "height": 700}, "reduced_motion": "reduce"} | options
    )
    opened = context.new_page()
    watch(opened, complaints)
    opened.goto(f"{address}#page-0")
    yield opened
    context.close()
    assert complaints == []


def watch(opened: Page, complaints: list[str]) -> None:
    """Write down everything that a page must not do."""

    def seen(dialog: Dialog) -> None:
        complaints.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    def asked(url: str) -> None:
        if not url.startswith(("file:", "data:")):
            complaints.append(f"request: {url}")

    opened.on("console", lambda message: complaints.append(f"console: {message.text}"))
    opened.on("pageerror", lambda error: complaints.append(f"error: {error}"))
    opened.on("dialog", seen)
    opened.on("request", lambda request: asked(request.url))
    opened.on("websocket", lambda socket: asked(socket.url))


def names(page: Page, task: int = 1) -> list[str]:
    """Policies that a task's table shows, in order."""
    rows = page.locator(f"#task-{task} table.sortable tbody tr:visible")
    return rows.evaluate_all("rows => rows.map((row) => row.dataset.name)")


def head(page: Page, title: str, task: int = 1) -> Locator:
    return page.locator(f"#task-{task} table.sortable th").filter(has=page.get_by_role("button", name=title))


def pixels(page: Page) -> bytes:
    return page.locator("canvas:visible").screenshot()


def test_opens_from_disk_and_asks_for_nothing(page: Page, complaints: list[str]) -> None:
    assert page.title().endswith("leaderboard")
    assert page.locator("h2:visible").inner_text() == "SpaceCapture/SingleArm-v0"
    assert page.evaluate("performance.getEntriesByType('resource').length") == 0
    assert page.evaluate("fetch('https://example.org').then(() => 'came', () => 'refused')") == "refused"
    assert any("Content Security Policy" in text for text in complaints)
    complaints.clear()


def test_sorts_by_mouse_and_by_keyboard(page: Page) -> None:
    assert names(page) == ["still", "minimum_jerk", HOSTILE]
    title = head(page, "time to capture")
    title.click()
    assert title.get_attribute("aria-sort") == "ascending"
    assert names(page) == ["minimum_jerk", HOSTILE, "still"]
    title.get_by_role("button").focus()
    page.keyboard.press("Enter")
    assert title.get_attribute("aria-sort") == "descending"
    assert names(page) == ["still", HOSTILE, "minimum_jerk"]
    head(page, "policy").get_by_role("button").focus()
    page.keyboard.press("Space")
    assert title.get_attribute("aria-sort") is None
    assert names(page) == [HOSTILE, "minimum_jerk", "still"]


def test_the_ranking_comes_back_and_ties_do_not_depend_on_the_click_before(page: Page) -> None:
    ranking = ["still", "minimum_jerk", HOSTILE]
    for before in ("time to capture", "policy", "final attitude"):
        for _ in range(2):
            head(page, before).click()
            moved = names(page)
            for order in ("descending", "ascending"):
                head(page, "success").click()  # of all of them 100 %
                assert head(page, "success").get_attribute("aria-sort") == order
                assert names(page) == ranking, (before, moved)
            head(page, before).click()
    head(page, "policy").click()
    assert names(page) != ranking
    head(page, "rank").click()
    assert head(page, "rank").get_attribute("aria-sort") == "ascending"
    assert names(page) == ranking


def test_filters_by_words_difficulty_and_split(page: Page) -> None:
    words = page.get_by_role("searchbox", name="Filter policies")
    words.focus()
    page.keyboard.type("JERK")
    assert names(page) == ["minimum_jerk"] and names(page, 0) == []
    assert page.locator("output:visible").inner_text() == "1 of 7 rows"
    words.fill("")
    assert len(names(page)) == 3
    page.get_by_label("Difficulty").select_option("easy")
    assert names(page) == [] and names(page, 0) == ["mpc", "still"]
    assert not page.locator("#task-1").is_visible() and page.locator("#task-0").is_visible()
    assert page.locator("#page-0 select[data-filter=split]").count() == 0  # there is one only


def test_pages_are_links(page: Page) -> None:
    page.get_by_role("link", name="DualArmPlanar").click()
    until(page, "document.querySelector('#page-1 h2').offsetParent")
    assert page.locator("h2:visible").inner_text() == "SpaceCapture/DualArmPlanar-v0"
    page.get_by_role("link", name="Provenance").focus()
    page.keyboard.press("Enter")
    until(page, "document.querySelector('#about').offsetParent")
    assert "--policy random hold" in page.locator("pre:visible").inner_text()
    page.go_back()
    until(page, "!document.querySelector('#page-1').hidden")


@pytest.mark.parametrize("options", [{}, {"reduced_motion": "no-preference"}], ids=["still", "moving"])
def test_a_replay_plays_by_itself_only_where_motion_is_wanted(page: Page, options: dict[str, str]) -> None:
    player = page.locator(".player:visible").first
    player.scroll_into_view_if_needed()
    until(page, "document.querySelector('.player .readout').textContent")
    if options:
        until(page, "document.querySelector('.player .time').value > 0.2")
        assert player.get_by_role("button", name="Pause").is_visible()
    else:
        page.wait_for_timeout(150)
        assert player.locator(".time").input_value() == "0"
        assert player.get_by_role("button", name="Play").is_visible()


def rested(page: Page) -> bytes:
    """The canvas once it changes no more: on a loaded machine the first frames come late."""
    before = pixels(page)
    for _ in range(40):
        page.wait_for_timeout(150)
        now = pixels(page)
        if now == before:
            return now
        before = now
    raise AssertionError("the canvas does not come to rest")


def test_a_replay_plays_turns_and_is_steered_by_keys(page: Page) -> None:
    page.get_by_role("link", name="Watch minimum_jerk").click()
    until(page, "document.querySelector('.player .message').textContent.startsWith('Captured')")
    still = rested(page)
    assert len(still) > 20_000  # a picture
    player, slider = page.locator(".player:visible"), page.locator(".player:visible .time")

    player.get_by_role("button", name="Play").click()
    until(page, "document.querySelector('.player .time').value > 1")
    player.get_by_role("button", name="Pause").click()
    played = pixels(page)
    assert played != still
    cursor = float(player.locator(".cursor").get_attribute("x1") or "nan")
    share = float(slider.input_value()) / float(slider.get_attribute("max") or "nan")
    assert cursor == pytest.approx(600 * share)

    box = player.locator("canvas").bounding_box()
    assert box
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 220, steps=3)
    page.mouse.up()
    page.wait_for_timeout(50)
    turned = pixels(page)
    assert turned != played

    player.locator("canvas").focus()
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.keyboard.press(key)
        page.wait_for_timeout(50)
        assert (now := pixels(page)) != turned
        turned = now
    page.keyboard.press("Space")
    until(page, "document.querySelector('.play').getAttribute('aria-label') === 'Pause'")
    slider.focus()
    page.keyboard.press("End")
    until(page, "document.querySelector('.play').getAttribute('aria-label') === 'Play'")
    assert float(slider.input_value()) == pytest.approx(float(slider.get_attribute("max") or "nan"))
    assert "0.0 mm" not in player.locator(".readout").inner_text()

    player.get_by_role("button", name="worst").click()
    until(page, "document.querySelector('.episodes button:last-child').ariaPressed === 'true'")
    page.wait_for_timeout(50)
    assert pixels(page) != turned


def test_a_replay_without_webgl(engine: Playwright, address: str, complaints: list[str]) -> None:
    """A browser that draws nothing in 3D still shows the replay, on a plain canvas."""
    plain = engine.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-3d-apis"])
    page = plain.new_page(viewport={"width": 700, "height": 700}, reduced_motion="reduce")
    watch(page, complaints)
    page.goto(f"{address}#page-0")
    page.get_by_role("link", name="Watch minimum_jerk").click()
    until(page, "document.querySelector('.player .message').textContent.startsWith('Captured')")
    until(page, "document.querySelector('.player .readout').textContent")
    still = pixels(page)
    page.locator(".player .time").fill("5")
    until(page, "document.querySelector('.player .readout').textContent.startsWith('5.0')")
    assert len(still) > 20_000 and pixels(page) != still
    plain.close()
    assert complaints == []


@pytest.mark.parametrize(
    "options", [{"color_scheme": "light"}, {"color_scheme": "dark"}], ids=["light", "dark"]
)
def test_dark_and_light(page: Page, options: dict[str, str]) -> None:
    def brightness() -> float:
        color = page.evaluate("getComputedStyle(document.body).backgroundColor")
        return sum(map(int, color.removeprefix("rgb(").removesuffix(")").split(","))) / 3

    light = options["color_scheme"] == "light"
    assert (brightness() > 128) == light
    page.get_by_role("button", name="Dark or light page").click()
    assert (brightness() > 128) != light


@pytest.mark.parametrize("options", [PHONE], ids=["phone"])
def test_fits_a_phone(page: Page, options: dict[str, object]) -> None:
    for key in ("page-0", "page-1", "about"):
        page.evaluate(f"location.hash = '{key}'")
        until(page, f"!document.getElementById('{key}').hidden")
        assert page.evaluate("document.documentElement.scrollWidth") == 375, key
    page.evaluate("location.hash = 'page-0'")
    table = page.locator("#table-2")
    assert table.evaluate("box => box.scrollWidth > box.clientWidth && box.clientWidth < 375")


def test_hostile_names_do_nothing(page: Page, complaints: list[str]) -> None:
    page.get_by_role("link", name=f"Watch {HOSTILE}").click()
    until(page, "document.querySelector('.player .message').textContent.includes('onerror')")
    message = page.locator(".player .message").inner_text()
    assert message.startswith("Policy error after") and message.endswith(f"</script>{HOSTILE}")
    assert page.locator("img").count() == 0 and HOSTILE in names(page)
    assert page.locator(".player select.policy option:checked").inner_text() == HOSTILE
    assert complaints == []
    # What came in as markup would still be refused.
    page.evaluate(
        "document.body.insertAdjacentHTML('beforeend', '<p onclick=\"window.ran = 1\" id=bad>x</p>')"
    )
    page.evaluate("document.getElementById('bad').click()")
    assert page.evaluate("window.ran") is None
    assert any("Content Security Policy" in text for text in complaints)
    complaints.clear()
