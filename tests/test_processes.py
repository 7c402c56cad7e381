"""No process outlives the command that started it, however that ends; nobody waits for what is gone."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from result_folders import episodes, write_folder

from agents.commands import dataset, evaluate, show
from agents.commands.evaluate import main

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 60.0  # s, of a busy machine


def parents() -> dict[int, int]:
    """Parent of every process that there is and that has not ended."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = path.read_text().rpartition(") ")[2].split()[:2]
        except OSError:
            continue
        if state != "Z":
            found[int(path.parent.name)] = int(parent)
    return found


def descendants(process: int) -> set[int]:
    """Processes that a process started, and those that they started."""
    above, found, last = parents(), {process}, set()
    while found != last:
        last = found
        found = last | {child for child, parent in above.items() if parent in last}
    return found - {process}


def until(condition, what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.05)


@pytest.fixture
def evaluating(tmp_path: Path):
    """A running evaluation with two workers, in which a third-party policy takes its time for ever."""
    (tmp_path / "slow_policy.py").write_text(
        "import os, signal, time\n"
        "class Slow:\n"
        "    def __init__(self, context, seed):\n"
        "        open(f'{os.path.dirname(__file__)}/built-{os.getpid()}', 'w').close()\n"
        "        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):\n"
        "            signal.signal(number, signal.SIG_IGN)\n"
        "    def predict(self, observation, state=None, episode_start=None, deterministic=True):\n"
        "        open(f'{os.path.dirname(__file__)}/asked-{os.getpid()}', 'w').close()\n"
        "        while True: time.sleep(1.0)\n"
    )
    arguments = ["--policy", "slow_policy:Slow", "--episodes", "50", "--jobs", "2", "--no-pictures"]
    process = subprocess.Popen(
        [sys.executable, "evaluate.py", *arguments, "--output", str(tmp_path / "out")],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    until(lambda: len(list(tmp_path.glob("asked-*"))) >= 2 or process.poll() is not None, "it did not begin")
    started = descendants(process.pid)
    yield process, started
    for number in (process.pid, *started & set(parents())):
        try:
            os.kill(number, signal.SIGKILL)
        except ProcessLookupError:
            pass


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_nothing_outlives_an_evaluation(evaluating, number: signal.Signals) -> None:
    process, started = evaluating
    assert len(started) >= 4, process.communicate()  # two workers, and a process of the policy for each
    process.send_signal(number)
    # Its pipes are closed once nobody holds them any longer.
    _, told = process.communicate(timeout=PATIENCE)
    if number == signal.SIGTERM:
        assert process.returncode == 128 + number
        assert "stopped; what is done is kept, and the same command with --resume" in told
        assert "Traceback" not in told
    until(lambda: not started & set(parents()), "some of its processes are still there")


@pytest.mark.parametrize(
    "command",
    [
        ["evaluate.py", "--list"],
        ["train.py", "--help"],
        ["-m", "reproduce", "--help"],
        ["-m", "space_envs.robots.export"],
        ["-m", "benchmarks", "--list"],
    ],
)
def test_a_reader_that_leaves_early_is_no_error(command: list[str]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, stdout=writing, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(writing)
    assert done.stderr == ""
    assert done.returncode in (0, 141)


def test_a_table_that_nobody_reads_is_no_error(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "a", episodes(3))
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "evaluate.py", "show", str(folder)], cwd=ROOT, stdout=writing, stderr=subprocess.PIPE
    )
    os.close(writing)
    assert done.stderr == b""
    assert done.returncode == 141


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--polcy", "gjm"], "--polcy is unknown, did you mean --policy?"),
        (["show", "a", "--srot=x"], "--srot is unknown, did you mean --sort?"),
        (["compare", "a", "--outptu", "b"], "--outptu is unknown, did you mean --output?"),
    ],
)
def test_mistyped_options_name_the_nearest(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 2
    assert said in capsys.readouterr().err


def test_options_given_several_times_add_up_and_replace_the_default() -> None:
    for parser in (evaluate.parser(), dataset.parser()):
        words = ["--policy", "hold", "--env", "a", "b", "--policy", "random", "gjm", "--env", "c"]
        options = parser.parse_args(words)
        assert options.policy == ["hold", "random", "gjm"] and options.env == ["a", "b", "c"]
        assert parser.parse_args([]).policy in (["all"], ["experts"])  # the default stays as it was
    options = evaluate.parser().parse_args(["--split", "test", "--split", "ood", "--difficulty", "easy"])
    assert (options.split, options.difficulty) == (["test", "ood"], ["easy"])
    assert dataset.parser().parse_args(["--format", "npz", "--format", "minari"]).format == ["npz", "minari"]
    assert show.parser().parse_args(["out", "--task", "a", "--task", "b"]).task == ["a", "b"]
