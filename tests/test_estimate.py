"""A dry run says how long an evaluation takes, from what was measured on this machine, and keeps nothing."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from agents.commands.evaluate import main
from agents.commands.evaluation import dry_run
from space_envs.evaluation.harness import rates
from space_envs.evaluation.records.storage import read_records


def test_a_dry_run_measures_what_it_does_not_know_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPACE_ENVS_CACHE", str(tmp_path / "cache"))
    arguments = ["--policy", "hold", "--split", "validation", "--episodes", "3", "--no-pictures"]
    arguments += ["--jobs", "1", "--output", str(tmp_path / "out")]
    evaluated = []
    monkeypatch.setattr(
        dry_run, "evaluate_chunk", lambda chunk: evaluated.append(chunk) or SimpleNamespace(seconds=8.0)
    )
    assert main([*arguments, "--dry-run"]) == 0
    assert not (tmp_path / "out").exists()
    told = capsys.readouterr().out.replace("\n", "")
    assert [len(chunk.indices) for chunk in evaluated] == [dry_run.TRIAL]
    assert "1 chunk of episodes; about 39 s, between 9 and 190 s: 12 s of episodes with 1 job" in told
    assert "24 s of timing, 3 s for the report" in told
    # What was measured once is known.
    assert main([*arguments, "--dry-run"]) == 0
    assert len(evaluated) == 1
    assert main(arguments) == 0
    capsys.readouterr()
    rates.remember({rates.REPORT: rates.Seconds(1.0, 2.0, 4.0)})
    entry = read_records(tmp_path / "out" / "records.jsonl")[0].entry
    for name in (rates.playing(entry), rates.timing(entry), rates.REPORT):
        assert rates.recorded(name) is not None  # the evaluation told
    rates.remember({rates.playing(entry): rates.Seconds(1.0, 2.0, 3.0)})
    rates.remember({rates.timing(entry): rates.Seconds(5.0, 6.0, 7.0)})
    assert main([*arguments, "--episodes", "30", "--jobs", "4", "--dry-run"]) == 0
    # Two chunks, of 25 and of 5 episodes, on two of four processes: no less than the longer one.
    told = capsys.readouterr().out.replace("\n", "")
    assert (
        "2 chunks of episodes; about 58 s, between 31 and 86 s: 50 s of episodes with 4 jobs, 6 s of timing"
        in told
    )
