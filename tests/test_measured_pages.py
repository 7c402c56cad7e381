"""Pages of measured times: every id is measured, and where a bound is missed the page says so in words."""

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from benchmarks import planning, speed
from benchmarks.machine import verdict
from space_envs.control import CONTROL_MODES
from space_envs.registration import ENTRIES

DOCS = Path(__file__).parents[1] / "docs"


def tables(page: str) -> list[list[dict[str, str]]]:
    """Rows of a page's Markdown tables by their headings."""
    found = []
    for block in re.findall(r"(?:^\|.*\n)+", (DOCS / page).read_text(), re.MULTILINE):
        head, _, *rows = (
            [cell.strip() for cell in line.strip(" |").split("|")] for line in block.splitlines()
        )
        found.append([dict(zip(head, row, strict=True)) for row in rows])
    return found


def test_verdicts_are_words() -> None:
    assert verdict(0.1, 0.1) == "met"
    assert verdict(0.11, 0.1) == "missed by 10 %"


def test_planning_page_says_where_a_bound_is_missed() -> None:
    table = tables("planning.md")[0]
    assert {(row["robot"], row["method"].strip("`")) for row in table} == {
        (task.lower(), name) for name, (_, bounds) in planning.METHODS.items() for task in bounds
    }
    for row in table:
        assert row["bound on the median"].split()[0] == (
            "met" if float(row["median, s"]) <= float(row["bound, s"]) else "missed"
        )


def test_speed_page_says_whether_its_aims_are_reached() -> None:
    added = {
        (f"SpaceCapture/{row['id']}", row["control mode"], int(row["N"])): float(
            row["added, us per env step"]
        )
        for row in tables("speed.md")[0]
    }
    assert speed.aims(added) in (DOCS / "speed.md").read_text()


def test_speed_is_measured_for_every_id(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    measured = []

    def rates(
        env_id: str, n: int, mode: str, seconds: float, robot: Mapping[str, str]
    ) -> tuple[float, float]:
        measured.append((env_id, mode, n, *robot.values()))
        return 1000.0, 2000.0

    monkeypatch.setattr(speed, "vector_rates", rates)
    speed.main(["--rounds", "1"])
    assert measured == [
        (env_id, mode, n) for env_id in ENTRIES for mode in CONTROL_MODES for n in speed.SIZES
    ]
    printed = capsys.readouterr().out
    assert all(speed.short(env_id) in printed for env_id in ENTRIES)
    assert "goal at most 150 us, missed by 233 %; 0 of 8 rows are within it" in printed
    assert "goal at most 8 us, met; 16 of 16 rows are within it" in printed
    measured.clear()
    speed.main(["--rounds", "1", "--robot", "spatial_dual_arm"])
    assert {(env_id, robot) for env_id, _, _, robot in measured} == {
        ("SpaceCapture/DualArmSpatial-v0", "spatial_dual_arm")
    }
    assert "Vector environment, robot spatial_dual_arm, 2 threads" in capsys.readouterr().out
