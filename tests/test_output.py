"""Folders that commands write to: nothing of anybody else's is touched, and one process writes at a time."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from result_folders import episodes, write_folder

from agents.commands import replay
from agents.commands.evaluate import main
from agents.commands.train import main as train
from agents.demonstrations import __main__ as demonstrations
from reproduce.__main__ import main as reproduce
from space_envs.errors import ConfigurationError
from space_envs.evaluation.results.folders import read_folder
from space_envs.robots.export import main as export
from space_envs.system.output import MARK, held, holder

ROOT = Path(__file__).resolve().parents[1]
QUICK = ["--policy", "hold", "--episodes", "2", "--no-pictures", "--jobs", "1", "--split", "validation"]


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Somebody's folder, which has files and folders of the names that evaluations use."""
    folder = tmp_path / "mine"
    for name in ("chunks/thesis.txt", "plots/SingleArm/a.svg", "report.html", "summary.json", "run.json"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("precious")
    return folder


COMMANDS: dict[str, Callable[[str, Path], int]] = {
    "evaluate": lambda output, _: main([*QUICK, "--output", output]),
    "overwrite": lambda output, _: main([*QUICK, "--output", output, "--overwrite"]),
    "resume": lambda output, _: main([*QUICK, "--output", output, "--resume"]),
    "compare": lambda output, a: main(["compare", str(a), "--output", output]),
    "overwriting compare": lambda output, a: main(["compare", str(a), "--output", output, "--overwrite"]),
    "train": lambda output, _: train(["--algo", "bc", "--steps", "1", "--output", output]),
    "reproduce": lambda output, _: reproduce(["shah2013", "--cases", "1", "--output", output]),
    "demonstrations": lambda output, _: demonstrations.main(["--count", "1", "--output", output]),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_folders_of_others_are_refused_and_left_alone(
    command: str, foreign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(foreign)
    a = write_folder(tmp_path / "a", episodes(1))
    assert COMMANDS[command](str(foreign), a) == 2
    assert contents(foreign) == before
    assert f"{foreign} holds files, and no {MARK}" in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_an_empty_output_is_no_folder(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    a = write_folder(tmp_path / "a", episodes(1))
    with pytest.raises(SystemExit) as left:
        COMMANDS[command]("", a)
    assert left.value.code == 2
    assert "it must name a file or folder, got an empty text" in capsys.readouterr().err
    assert not list(Path().iterdir())


def test_a_folder_of_another_kind_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = write_folder(tmp_path / "a", episodes(1))
    with held(tmp_path / "out", "reproduction of a paper"):
        pass
    before = contents(tmp_path / "out")
    assert main(["compare", str(a), "--output", str(tmp_path / "out"), "--overwrite"]) == 2
    assert "is of a reproduction of a paper, not of a comparison" in capsys.readouterr().err
    assert contents(tmp_path / "out") == before


@pytest.mark.usefixtures("brief_reports")
def test_results_are_replaced_only_where_that_was_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    arguments = [*QUICK, "--output", str(folder)]
    assert main(arguments) == 0
    (folder / "notes.txt").write_text("mine")
    (folder / "plots").mkdir(exist_ok=True)
    (folder / "plots" / "notes.txt").write_text("mine")
    before = contents(folder)
    capsys.readouterr()
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert "holds an evaluation already: --resume goes on with it, --overwrite replaces it" in told
    assert contents(folder) == before
    assert main([*arguments, "--seeds", "1", "--overwrite"]) == 0
    after = contents(folder)
    assert after["records.jsonl"] != before["records.jsonl"]
    assert after["notes.txt"] == after["plots/notes.txt"] == b"mine"
    assert not (folder / "chunks").exists()
    with pytest.raises(SystemExit):
        main([*arguments, "--resume", "--overwrite"])


@pytest.mark.usefixtures("brief_reports")
def test_a_merged_folder_is_replaced_only_where_that_was_asked_for(tmp_path: Path) -> None:
    a, b = (write_folder(tmp_path / name, episodes(2, policy=name)) for name in ("a", "b"))
    output = ["--output", str(tmp_path / "out")]
    assert main(["compare", str(a), *output]) == 0
    before = contents(tmp_path / "out")
    assert main(["compare", str(b), *output]) == 2
    assert contents(tmp_path / "out") == before
    assert main(["compare", str(b), *output, "--overwrite"]) == 0
    assert contents(tmp_path / "out")["records.jsonl"] != before["records.jsonl"]


def test_files_are_replaced_only_where_that_was_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "arm.xml"
    file.write_text("precious")
    assert export(["-o", str(file)]) == 2
    assert "--overwrite replaces it" in capsys.readouterr().err
    assert file.read_text() == "precious"
    assert export(["-o", str(file), "--overwrite"]) == 0
    assert "<mujoco" in file.read_text()
    video = tmp_path / "capture.mp4"
    video.write_text("precious")
    a = write_folder(tmp_path / "a", episodes(1), recorded=True)
    assert replay.main([str(a), "--episode", "0", "--video", str(video)]) == 2
    assert video.read_text() == "precious"
    prior = tmp_path / "prior.npz"
    prior.with_suffix(".json").write_text("precious")
    assert demonstrations.main(["--count", "1", "--output", str(tmp_path / "d"), "--fit", str(prior)]) == 2
    assert not (tmp_path / "d").exists() and not prior.exists()


@pytest.mark.usefixtures("brief_reports")
def test_one_process_writes_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = "from pathlib import Path; from space_envs.system.output import held; import time\n"
    code += (
        f"with held(Path({str(tmp_path / 'out')!r}), 'evaluation'): print('held', flush=True); time.sleep(60)"
    )
    other = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE)
    try:
        assert other.stdout is not None and other.stdout.readline() == b"held\n"
        assert holder(tmp_path / "out") is not None
        for more in ([], ["--resume"], ["--overwrite"]):
            assert main([*QUICK, "--output", str(tmp_path / "out"), *more]) == 2
            assert f"process {other.pid} on " in capsys.readouterr().err
    finally:
        other.kill()
        other.wait()
    # Its mark stays, and holds nothing any longer.
    assert holder(tmp_path / "out") is None
    assert main([*QUICK, "--output", str(tmp_path / "out")]) == 0
    assert f"{other.pid}" not in (tmp_path / "out" / MARK).read_text()


def test_a_running_evaluation_is_told_from_an_interrupted_one(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    (folder / "chunks").mkdir(parents=True)
    plan = '{"entries": [["a"], ["b"]], "episodes": 60, "seeds": [0, 1]}'
    (folder / "run.json").write_text(plan)
    (folder / "chunks" / "one.npz").write_text("")
    with pytest.raises(ConfigurationError, match="was interrupted; run the same command with --resume"):
        read_folder(folder)
    with (folder / MARK).open("w") as mark:
        mark.write('{"kind": "evaluation", "process": 1234}\n')
        mark.flush()
        fcntl.flock(mark, fcntl.LOCK_EX)
        with pytest.raises(ConfigurationError, match="process 1234 .* is evaluating into .*: 1 of 12 chunks"):
            read_folder(folder)
        write_folder(tmp_path / "old", episodes(2))
        for name in ("records.jsonl", "summary.json"):
            (tmp_path / "old" / name).rename(folder / name)
        assert "is running, 1 of 12 chunks of 25 episodes evaluated;" in read_folder(folder).notes[0]
        for number in range(11):
            (folder / "chunks" / f"{number}.npz").write_text("")
        assert "is running, 12 of 12 chunks of 25 episodes evaluated; timing" in read_folder(folder).notes[0]
    assert "was interrupted" in read_folder(folder).notes[0]


@pytest.mark.parametrize("content", ["[]", "null", "5", "[" * 100_000, "{", '{"entries": 3}', "{}"])
def test_a_damaged_plan_is_an_error_of_one_line(
    content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    with held(folder, "evaluation"):
        (folder / "run.json").write_text(content)
    assert main([*QUICK, "--output", str(folder), "--resume"]) == 2
    told = capsys.readouterr().err
    assert "run.json cannot be read" in told or "holds another evaluation" in told
    assert told.count("\n") == 1
    assert main(["show", str(folder)]) == 2


def test_a_named_pipe_in_a_folder_does_not_hold_a_command_up(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with held(folder, "evaluation"):
        os.mkfifo(folder / "run.json")
    assert main([*QUICK, "--output", str(folder), "--resume"]) == 2


def test_a_full_disk_ends_in_one_line(tmp_path: Path) -> None:
    """The limit of a file's size stands for a full disk: the same error comes from the same call."""
    arguments = [sys.executable, "evaluate.py", *QUICK, "--output", str(tmp_path / "out")]
    limited = ["bash", "-c", 'ulimit -f 8; exec "$@"', "bash", *arguments]
    full = subprocess.run(limited, cwd=ROOT, capture_output=True, text=True)
    assert full.returncode == 1, full.stderr
    assert "Traceback" not in full.stderr
    assert "the same command with --resume goes on from here" in full.stderr


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_in_one_line(number: signal.Signals, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "evaluate.py", *QUICK, "--output", str(folder), "--episodes", "256"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        # Shells start jobs in the background with SIGINT ignored, which children inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while not (folder / "run.json").exists():
        time.sleep(0.01)
    process.send_signal(number)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert "stopped; what is done is kept" in told
    assert "Traceback" not in told
