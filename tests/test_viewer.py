"""MuJoCo's viewer on a virtual X server: `evaluate.py replay` opens a window in which the robot moves."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from agents.commands.evaluate import main

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 60.0  # for a window on a slow machine


@pytest.fixture
def screen(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Name of a display, and the file that holds what can be seen there."""
    if shutil.which("Xvfb") is None:
        pytest.skip("there is no Xvfb")
    read, write = os.pipe()
    options = ["-displayfd", str(write), "-screen", "0", "1024x768x24", "-fbdir", str(tmp_path)]
    server = subprocess.Popen(["Xvfb", *options], pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as file:
        display = file.readline().strip()
    yield f":{display}", tmp_path / "Xvfb_screen0"
    server.terminate()
    server.wait()


def changed(path: Path, before: np.ndarray) -> np.ndarray:
    """What can be seen, once more than a thousandth of it is another than before."""
    until = time.monotonic() + SECONDS
    while time.monotonic() < until:
        now = np.fromfile(path, np.uint8)
        if np.mean(now != before) > 1e-3:
            return now
        time.sleep(0.1)
    raise TimeoutError("nothing on the screen changed")


@pytest.mark.slow
def test_a_replay_moves_in_the_viewer(screen: tuple[str, Path], tmp_path: Path) -> None:
    display, pixels = screen
    results = tmp_path / "results"
    played = ["--policy", "gjm", "--episodes", "1", "--no-pictures", "--jobs", "1", "--output", str(results)]
    assert main(played) == 0
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    process = subprocess.Popen(
        [sys.executable, "evaluate.py", "replay", str(results), "--episode", "0"],
        cwd=ROOT,
        env=environment | {"DISPLAY": display},
        stderr=subprocess.PIPE,
        text=True,
    )
    seen = np.fromfile(pixels, np.uint8)
    try:
        for _ in range(8):  # the window comes up, and then the robot moves
            seen = changed(pixels, seen)
        assert process.poll() is None
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=SECONDS)
    assert process.returncode == 130, said
