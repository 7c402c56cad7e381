"""Results of several people in one leaderboard: what fits is merged, the rest refused with the reason."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from result_folders import configuration, edit, episodes, made_episodes, write_folder
from synthetic_results import FAILED

from agents.commands import compare
from agents.commands.show import main as show
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.episode_file import load_episodes, save_episodes
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.storage import read_records, write_records
from space_envs.evaluation.report.folder import write_report
from space_envs.evaluation.results.folders import read_folder
from space_envs.evaluation.results.merge import Source, merge
from space_envs.evaluation.results.result import EvaluationResult, entry_stem


def merged(*folders: Path | Source, separate: bool = False) -> tuple[EvaluationResult, list[str]]:
    sources = [each if isinstance(each, Source) else Source(read_folder(each)) for each in folders]
    return merge(sources, {"command": "compare"}, separate)


# What fits -------------------------------------------------------------------------------------------------


def test_two_people_become_one_leaderboard(tmp_path: Path) -> None:
    mine, theirs = episodes(3), episodes(3, policy="promp") + episodes(3, policy="hold", **FAILED)
    a, b = write_folder(tmp_path / "a", mine), write_folder(tmp_path / "b", theirs)
    result, notes = merged(a, b)
    assert notes == []
    assert list(result.records) == mine + theirs
    about = result.provenance
    assert about["command"] == "compare"
    assert list(about["configurations"].values()) == [configuration()]
    assert about["sources"][str(a)]["command"] == "evaluate.py --output a"
    assert about["sources"][str(b)]["records"] == 6
    # The order in which folders are named does not change what is in the rows.
    other, _ = merged(b, a)
    key = EpisodeRecord.to_json
    assert sorted(map(key, other.records)) == sorted(map(key, result.records))


def test_what_stands_in_both_alike_counts_once(tmp_path: Path) -> None:
    first = episodes(4)
    timing = {"planning_ms": 900.0, "action_ms": 9.0, "processor": "another", "threads": 2}
    again = [replace(record, timing=timing) for record in first[1:]]  # type: ignore[arg-type]
    a, b = write_folder(tmp_path / "a", first), write_folder(tmp_path / "b", again)
    result, notes = merged(a, b)
    assert list(result.records) == first
    assert notes == [f"3 episodes stand in {a} and in {b} alike and are counted once"]


def test_different_results_under_one_name_are_refused_and_can_be_told_apart(tmp_path: Path) -> None:
    ours, others = episodes(3), episodes(2) + episodes(1, episode=2, index=12, **FAILED)
    a, b = write_folder(tmp_path / "a", ours), write_folder(tmp_path / "b", others)
    with pytest.raises(ConfigurationError) as caught:
        merged(a, b)
    said = str(caught.value)
    assert "episode 2 of seed 0 of 'mpc' (joint_velocity)" in said
    assert f"is in {a} and in {b} with different results: outcome is 'captured' and 'timeout'" in said
    assert f"--name {b}=WHOSE" in said
    result, notes = merged(a, Source(read_folder(b), "Ann"))
    assert [record.policy for record in result.records] == ["mpc"] * 3 + ["mpc (Ann)"] * 3
    assert notes == []
    assert result.provenance["sources"][str(b)]["renamed"] == "Ann"
    # Renamed records are whole records of their own.
    path = tmp_path / "records.jsonl"
    write_records(path, result.records)
    assert read_records(path) == list(result.records)


def test_one_policy_from_two_people_is_put_together_with_a_note(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2, seed=1))
    result, notes = merged(a, b)
    assert [(record.seed, record.episode) for record in result.records] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    (note,) = notes
    assert "'mpc'" in note and f"2 from {a}, 2 from {b}" in note and "--name" in note


def test_policies_played_on_different_goals_are_noted(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(4))
    b = write_folder(tmp_path / "b", episodes(2, policy="promp"))
    _, notes = merged(a, b)
    (note,) = notes
    assert "mpc (joint_velocity) on 4, promp (joint_velocity) on 2; 2 in common" in note


def test_other_tasks_are_tables_of_their_own(tmp_path: Path) -> None:
    planar = configuration(env_id="SpaceCapture/DualArmPlanar-v0")
    a = write_folder(tmp_path / "a", episodes(2) + episodes(2, split="ood"))
    b = write_folder(
        tmp_path / "b", episodes(2, policy="promp") + episodes(2, planar), [configuration(), planar]
    )
    result, _ = merged(a, b)
    assert {str(record.entry.task) for record in result.records} == {
        "SpaceCapture/SingleArm-v0, shyam2020/paper, medium, test split",
        "SpaceCapture/SingleArm-v0, shyam2020/paper, medium, ood split",
        "SpaceCapture/DualArmPlanar-v0, shah2013, medium, test split",
    }


# What does not fit -----------------------------------------------------------------------------------------


def test_another_configuration_is_refused_with_what_differs(tmp_path: Path) -> None:
    easier = configuration(horizon=400, envelope={"position": 0.1, "hold": 1.0}, variant="physical")
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2, easier, policy="promp"), [easier])
    with pytest.raises(ConfigurationError) as caught:
        merged(a, b)
    said = str(caught.value)
    assert said.startswith("records of SpaceCapture/SingleArm-v0, medium, cannot be compared")
    for difference in (
        f"horizon is 200 in {a} and 400 in {b}",
        f"envelope.position is 0.05 in {a} and 0.1 in {b}",
        f"variant is absent in {a} and 'physical' in {b}",
    ):
        assert difference in said
    assert "hold" not in said and "control_mode" not in said


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("difficulty", ["medium", "hard"])
def test_another_version_of_the_task_is_refused_by_name(
    tmp_path: Path, separate: bool, difficulty: str
) -> None:
    older = configuration(task_version=1, difficulty=difficulty)
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2, older, policy="promp", task_version=1), [older])
    with pytest.raises(ConfigurationError) as caught:
        merged(a, b, separate=separate)
    assert f"SpaceCapture/SingleArm-v0 are of task version 3 in {a} and task version 1 in {b}" in str(
        caught.value
    )


def test_the_hashes_are_named_where_the_configuration_is_not_known(tmp_path: Path) -> None:
    other = configuration(horizon=400)
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2, other, policy="promp"), [])
    with pytest.raises(ConfigurationError) as caught:
        merged(a, b)
    hashes = [read_folder(each).records[0].config_hash for each in (a, b)]
    assert f"{hashes[0]} in {a} and {hashes[1]} in {b}; {b} does not say" in str(caught.value)


def test_control_modes_of_one_task_share_a_table_unless_the_rest_differs(tmp_path: Path) -> None:
    torque = configuration(control_mode="joint_torque")
    longer = configuration(control_mode="joint_torque", horizon=400)
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2, torque), [torque])
    c = write_folder(tmp_path / "c", episodes(2, longer, policy="promp"), [longer])
    result, _ = merged(a, b)
    assert len({record.entry.task for record in result.records}) == 1
    with pytest.raises(ConfigurationError, match="horizon is 200 in .*a and 400 in .*c"):
        merged(a, c)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"split": "ood"}, "medium, differs in its split: .*a has test; .*b has ood"),
        ({"difficulty": "hard"}, "SingleArm-v0 differs in its difficulty: .*a has medium; .*b has hard"),
        ({"env_id": "SpaceCapture/SingleArm-v1"}, "SingleArm differs in its version: .*a has v0; .*b has v1"),
    ],
)
def test_another_version_difficulty_or_split_is_refused(
    tmp_path: Path, changes: dict[str, str], said: str
) -> None:
    settings = {name: value for name, value in changes.items() if name != "split"}
    config = configuration(**settings)
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2, config, policy="promp", **changes), [config])
    with pytest.raises(ConfigurationError, match=said):
        merged(a, b)
    result, _ = merged(a, b, separate=True)
    assert len({record.entry.task for record in result.records}) == 2
    # A third folder that has both is what they can be compared with.
    both = episodes(2, policy="hold") + episodes(2, config, policy="hold", **changes)
    c = write_folder(tmp_path / "c", both, [configuration(), config])
    assert len(merged(a, b, c)[0].records) == 8


def test_an_episode_twice_in_one_folder_is_refused(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(2) + episodes(1))
    with pytest.raises(ConfigurationError, match=r"a/records\.jsonl: episode 0 of seed 0 of 'mpc'.* twice"):
        merged(a)


# Recorded episodes -----------------------------------------------------------------------------------------


def test_recorded_episodes_and_replays_are_those_of_the_episodes_that_count(tmp_path: Path) -> None:
    first = episodes(3, index=7)
    second = first[1:] + episodes(2, index=7, seed=1)
    a, b = (
        write_folder(tmp_path / name, each, recorded=True) for name, each in (("a", first), ("b", second))
    )
    result, _ = merged(a, b)
    ((entry, recorded),) = result.episodes.items()
    pairs = list(zip(recorded.seed.tolist(), recorded.episode.tolist(), strict=True))
    assert pairs == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]
    # In the made-up episodes the first joint says which episode it is.
    np.testing.assert_allclose(recorded.scene[:, 0, 7], recorded.episode)
    assert [replay.label for replay in result.replays[entry]] == ["best", "median", "worst"]
    for replay in result.replays[entry]:
        assert replay.scene[0, 7] == replay.episode
        assert len(replay.time) == 126


def test_renamed_policies_keep_their_episodes(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(2), recorded=True)
    b = write_folder(tmp_path / "b", episodes(2, **FAILED, steps=200), recorded=True)
    result, _ = merged(a, Source(read_folder(b), "Ann"))
    assert {entry.policy: recorded.entry.policy for entry, recorded in result.episodes.items()} == {
        "mpc": "mpc",
        "mpc (Ann)": "mpc (Ann)",
    }
    outcomes = {entry.policy: set(recorded.outcome.tolist()) for entry, recorded in result.episodes.items()}
    assert outcomes == {"mpc": {"captured"}, "mpc (Ann)": {"timeout"}}


def test_edited_or_foreign_episodes_are_refused(tmp_path: Path) -> None:
    records = episodes(2)
    a = write_folder(tmp_path / "a", records, recorded=True)
    (path,) = (a / "episodes").iterdir()
    good = load_episodes(path)
    save_episodes(path, replace(good, scene=good.scene + 1.0))
    with pytest.raises(ConfigurationError, match=r"\.npz is not what was written"):
        merged(a)
    # Where the checksum was made to fit, the records still know how the episodes ended.
    summary: dict[str, Any] = json.loads((a / "summary.json").read_text())
    del summary["checksums"]
    (a / "summary.json").write_text(json.dumps(summary))
    save_episodes(path, replace(good, length=good.length - 1))
    with pytest.raises(ConfigurationError, match=r"episode 0 of seed 0 is another one than in"):
        merged(a)


def test_files_that_the_summary_does_not_know_are_left_alone(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(2))
    b = write_folder(tmp_path / "b", episodes(2), recorded=True)
    (b / "episodes").rename(a / "episodes")
    assert not merged(a)[0].episodes


def test_a_task_of_another_suite_is_compared_without_replays(tmp_path: Path) -> None:
    records = episodes(2)
    a = write_folder(tmp_path / "a", records, recorded=True)
    result, notes = merged(a)
    assert result.replays and not notes
    config = configuration(env_id="Mine/Own-v0")
    foreign = [replace(record, env_id="Mine/Own-v0", checksum="") for record in episodes(2, config)]
    b = write_folder(tmp_path / "b", foreign, [config])
    (recorded,) = result.episodes.values()
    target = b / "episodes" / f"{entry_stem(foreign[0].entry)}.npz"
    save_episodes(target, replace(recorded, entry=foreign[0].entry))
    (b / "summary.json").unlink()
    result, notes = merged(b)
    assert len(result.episodes) == 1 and not result.replays
    assert any("no replays of Mine/Own-v0" in note for note in notes)


# The command -----------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("brief_reports")
def test_the_command_writes_what_an_evaluation_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = tmp_path / "a"
    records = episodes(4)
    recorded = {records[0].entry: made_episodes(records)}
    write_report(EvaluationResult(records, recorded, {"configurations": {}}), a)
    b = write_folder(tmp_path / "b", episodes(4, policy="mpc", final_attitude=1.0))
    output = tmp_path / "both"
    given = [str(a), str(b), "--output", str(output)]
    capsys.readouterr()
    assert compare.main(given) == 2
    assert "different results" in capsys.readouterr().err
    assert not output.exists()
    assert compare.main([*given, "--name", f"{b}=Ann"]) == 0
    said = capsys.readouterr()
    assert "mpc (Ann)" in said.out and str(output / "report.html") in said.out
    assert {"records.jsonl", "summary.json", "leaderboard.md", "leaderboard.csv", "report.html"} <= {
        path.name for path in output.iterdir()
    }
    assert len(read_records(output / "records.jsonl")) == 8
    assert len(list((output / "episodes").iterdir())) == 1
    assert "mpc (Ann)" in (output / "report.html").read_text()
    # What compare left can be shown and compared again, and is as safe from edits.
    assert show([str(output), "--sort", "final_attitude"]) == 0
    table = capsys.readouterr().out
    assert table.index("mpc (Ann)") < table.index("mpc  ")
    result, _ = merged(output)
    assert len(result.records) == 8 and len(result.episodes) == 1
    edit(output / "records.jsonl", '"action_ms": 0.5', '"action_ms": 0.1')
    assert show([str(output)]) == 2
    assert "is not what was written" in capsys.readouterr().err


def test_a_column_that_there_is_not_names_the_nearest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = write_folder(tmp_path / "a", episodes(2))
    for name, nearest in (("cost", "attitude_cost"), ("sucess", "success")):
        assert show([str(a), "--sort", name]) == 2
        assert f"Did you mean {nearest!r}?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["a", "a/../a", "--output", "c"], "a is given twice"),
        (["a", "b", "--output", "b"], "--output b is one of the folders"),
        (["a", "b", "--output", "run"], "run holds files, and no .space-capture"),
        (["a", "b", "--output", "c", "--name", "bb=Ann"], "unknown folder in --name 'bb'"),
        (["a", "b", "--output", "c", "--name", "Ann"], "--name takes RESULTS=NAME, got 'Ann'"),
        (["a", "b", "--output", "c", "--name", "b="], "--name takes RESULTS=NAME"),
        (["a", "b", "--output", "c", "--name", "b=x", "--name", "b=y"], "--name names b twice"),
        (["a", "nothing", "--output", "c"], "nothing does not exist"),
        (["a", "b", "--output", "a/records.jsonl/c"], "cannot write to"),
    ],
)
def test_mistakes_on_the_command_line_are_one_line(
    tmp_path: Path,
    given: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_folder(Path("a"), episodes(1))
    write_folder(Path("b"), episodes(1, policy="promp"))
    Path("run").mkdir()
    Path("run/run.json").write_text("{}")
    assert compare.main(given) == 2
    error = capsys.readouterr().err.strip()
    assert error.splitlines()[-1].startswith("evaluate.py compare: ") and said in error
    assert not Path("c").exists()
