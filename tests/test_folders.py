"""Result folders are read as they were written, or refused with file, line and what is wrong."""

import json
from pathlib import Path

import pytest
from result_folders import edit, episodes, write_folder
from synthetic_results import make_record

from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.results.folders import read_folder


def test_edited_records_name_file_and_line(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(3))
    lines = (a / "records.jsonl").read_text().splitlines()
    lines[1] = lines[1].replace('"final_attitude": 4.5', '"final_attitude": 0.5')
    (a / "records.jsonl").write_text("\n".join(lines) + "\n")
    with pytest.raises(ConfigurationError, match=r"a/records\.jsonl:2: .*the record was edited"):
        read_folder(a)


@pytest.mark.parametrize("change", ["removed", "swapped", "timing"])
def test_edited_files_of_whole_records_are_refused(tmp_path: Path, change: str) -> None:
    a = write_folder(tmp_path / "a", episodes(3))
    path = a / "records.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    changed = {
        "removed": lines[1:],
        "swapped": lines[::-1],
        "timing": [line.replace('"action_ms": 0.5', '"action_ms": 0.1') for line in lines],
    }[change]
    assert changed != lines
    path.write_text("".join(changed))
    assert read_records(path)  # each record by itself is sound
    with pytest.raises(ConfigurationError, match=r"a/records\.jsonl is not what was written: its SHA-256 is"):
        read_folder(a)


def test_edited_configurations_are_refused(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(2))
    edit(a / "summary.json", '"horizon": 200', '"horizon": 400')
    with pytest.raises(ConfigurationError, match=r"summary\.json: the configuration \w+ has the hash \w+"):
        read_folder(a)


def test_records_of_another_schema_are_refused(tmp_path: Path) -> None:
    a = write_folder(tmp_path / "a", episodes(2))
    old = json.loads(make_record().to_json()) | {
        "schema": 1,
        "timing": {"planning_ms": 1.0, "action_ms": 1.0},
    }
    del old["checksum"]
    (a / "records.jsonl").write_text(json.dumps(old) + "\n")
    with pytest.raises(
        ConfigurationError, match=r"records\.jsonl:1: schema is 1; this version reads schema 4"
    ):
        read_folder(a)


@pytest.mark.parametrize("schema", [99, 1, None, "3", 2.5])
def test_summaries_of_another_schema_are_refused(tmp_path: Path, schema: object) -> None:
    a = write_folder(tmp_path / "a", episodes(2))
    told = json.loads((a / "summary.json").read_text())
    (a / "summary.json").write_text(json.dumps(told | {"schema": schema}))
    with pytest.raises(ConfigurationError, match=r"summary\.json: its schema is .*reads schema \d"):
        read_folder(a)


def test_folders_that_are_none_or_incomplete_say_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="none does not exist"):
        read_folder(tmp_path / "none")
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="file is a file; expected a folder"):
        read_folder(tmp_path / "file")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigurationError, match=r"is no folder of results: it has no records\.jsonl"):
        read_folder(tmp_path / "empty")
    for left in ("chunks", "run.json"):
        folder = tmp_path / f"killed {left}"
        (folder / left).mkdir(parents=True) if left == "chunks" else folder.mkdir()
        (folder / "run.json").write_text("{}")
        with pytest.raises(ConfigurationError, match="was interrupted; run the same command with --resume"):
            read_folder(folder)
    old = write_folder(tmp_path / "old", episodes(2))
    assert read_folder(old).notes == ()
    (old / "chunks").mkdir()
    assert "interrupted; these are the results from before" in read_folder(old).notes[0]
    (old / "summary.json").write_text("[")
    with pytest.raises(ConfigurationError, match=r"summary\.json: not a summary.*--resume finishes it"):
        read_folder(old)
    (old / "summary.json").unlink()
    assert "no summary.json" in read_folder(old).notes[1]
    (old / "records.jsonl").write_text("")
    with pytest.raises(ConfigurationError, match=r"records\.jsonl is empty"):
        read_folder(old)


@pytest.mark.parametrize(
    "text",
    [
        '{"provenance": []}',
        '{"provenance": {"configurations": {"x": 3}}}',
        '{"checksums": 3}',
        "3",
        "[" * 100_000,
        "null",
    ],
)
def test_malformed_summaries_are_refused(tmp_path: Path, text: str) -> None:
    a = write_folder(tmp_path / "a", episodes(1))
    (a / "summary.json").write_text(text)
    with pytest.raises(ConfigurationError, match=r"summary\.json: not a summary of results"):
        read_folder(a)
