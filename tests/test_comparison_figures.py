"""Figures that set policies against each other: complete, repeatable, well-formed, described."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from synthetic_results import HOSTILE, Character, make_result, played, rows_of

from space_envs.evaluation.leaderboard.comparison import COSTS
from space_envs.evaluation.leaderboard.pareto import FRONT
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.report.drawing.look import make_looks
from space_envs.evaluation.report.drawing.panel import Panel
from space_envs.evaluation.report.plots.comparison import comparison_plots
from space_envs.evaluation.report.plots.plot import Plot


def plots_of(records: Sequence[EpisodeRecord], seed: int = 0) -> dict[str, Plot]:
    rows = rows_of(records)
    looks = make_looks(list(dict.fromkeys(row.policy for row in rows)))
    plots = comparison_plots(rows, records, looks, np.random.default_rng(seed), resamples=200)
    return {plot.key: plot for plot in plots}


def texts_of(panel: Panel) -> Iterator[ElementTree.Element]:
    return ElementTree.fromstring(panel.svg).iter("{http://www.w3.org/2000/svg}text")


def test_plots_hold_every_policy() -> None:
    extra = {f"number_{k}": Character(0.9 - k / 40, 5, 1 + k, 5e-3, 5 + k, None, 0.1 + k) for k in range(11)}
    records = make_result(episodes=20, extra=extra | {HOSTILE: extra["number_3"]}).records
    plots = plots_of(records)
    assert list(plots) == ["profiles", "improvement", "improvement_cost", "pareto"]
    assert [len(plot.panels) for plot in plots.values()] == [len(COSTS), 1, 1, 1]
    captured = {record.policy for record in records if record.captured}
    for plot in plots.values():
        for panel in plot.panels:
            text = "".join(ElementTree.fromstring(panel.svg).itertext())
            assert "<img" not in panel.svg
            for policy in captured if plot.key == "pareto" else {record.policy for record in records}:
                assert policy in panel.alt
                assert policy[:17] in text
    (panel,) = plots["improvement"].panels
    assert panel.figure
    boxes = [text.get_window_extent() for text in panel.figure.axes[0].texts]
    assert len(boxes) == 20 * 19
    assert all(box.count_overlaps(boxes) == 1 for box in boxes)  # with itself alone
    # 20 policies: every number of the matrix but the diagonal's stands in it.
    texts = texts_of(plots["improvement"].panels[0])
    assert sum((each.text or "").strip().isdigit() for each in texts) == 20 * 19


def test_plots_repeat_and_ids_do_not() -> None:
    records = make_result(episodes=10, policies=("hold", "gjm", "mpc")).records
    first = plots_of(records)
    assert plots_of(list(reversed(records))) == first
    assert plots_of(records, seed=1) != first
    ids = [
        each.attrib["id"]
        for plot in first.values()
        for panel in plot.panels
        for each in ElementTree.fromstring(panel.svg).iter()
        if "id" in each.attrib
    ]
    assert all(one != other for one, other in pairwise(sorted(ids)))


def test_plots_say_what_the_numbers_are() -> None:
    records = played("a", [1.0] * 9) + played("b", [2.0] * 9) + played("hold", [None] * 9)
    plots = plots_of(records)
    alt = plots["improvement"].panels[0].alt
    assert alt == (
        "a: clearly better than 2, clearly worse than 0 of 2; b: clearly better than 1, clearly worse than 1 "
        "of 2; hold: clearly better than 0, clearly worse than 2 of 2"
    )
    assert "Goal by goal" in plots["improvement"].caption
    assert FRONT in plots["pareto"].caption
    assert plots["pareto"].panels[0].alt == (
        "a: score 0.5, 20.5 ms, 100 % captured, on the front; b: score 0.333, 20.5 ms, 100 % captured, "
        "dominated by a"
    )


def test_costs_are_compared_on_goals_that_both_captured_with_their_number() -> None:
    records = played("a", [1.0] * 9) + played("b", [2.0] * 6 + [None] * 3) + played("hold", [None] * 9)
    (panel,) = plots_of(records)["improvement_cost"].panels
    texts = ["".join(each.itertext()).strip() for each in texts_of(panel)]
    assert texts.count("of 6") == 2 and texts.count("-") == 4  # those of hold
    assert panel.alt.startswith("a: clearly better than 0, clearly worse than 0 of 1; b: ")


def test_a_control_mode_is_named_where_it_is_not_the_usual_one() -> None:
    records = played("a", [1.0] * 4) + played("a", [2.0] * 4, control_mode="torque") + played("b", [3.0] * 4)
    alt = plots_of(records)["pareto"].panels[0].alt
    assert "a: " in alt and "a (torque): " in alt and "b: " in alt


def test_plots_without_data_are_left_out() -> None:
    untimed = {"planning_ms": None, "action_ms": None, "processor": None, "threads": None}
    assert list(plots_of(played("a", [1.0, 2.0]))) == ["profiles", "pareto"]
    assert list(plots_of(played("a", [None] * 3) + played("b", [None] * 3, timing=untimed))) == [
        "improvement"
    ]
    some = plots_of(played("a", [1.0, 2.0]) + played("b", [1.0, 3.0], timing=untimed))
    assert "Not timed and not shown: b." in some["pareto"].caption
    assert list(plots_of(played("a", [1.0], timing=untimed))) == ["profiles"]


@pytest.mark.parametrize("attitudes", [[0.0, 0.0], [0.0, 1.0], [1e-9, 5.0], [2.0, 2.0]])
def test_plots_of_odd_values_can_be_drawn(attitudes: list[float]) -> None:
    plots = plots_of(played("a", attitudes) + played("b", [3.0, None]))
    for plot in plots.values():
        for panel in plot.panels:
            assert "nan" not in panel.svg.lower()
