"""`show` and `replay`: tables and episodes of a result folder, and plain reasons where there are none."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from result_folders import configuration, episodes, write_folder
from synthetic_results import FAILED, changed

from agents.commands import replay as command
from agents.commands.show import main as show
from agents.commands.show import of_tasks, sorted_rows
from space_envs.errors import ConfigurationError, RenderingError
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.results.folders import read_folder
from space_envs.system import opengl
from space_envs.system.opengl import missing_gl

SINGLE, DUAL = "SpaceCapture/SingleArm-v0", "SpaceCapture/DualArmPlanar-v0"
PLANAR = configuration(env_id=DUAL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two policies on one task, one of them with two seeds and a failure."""
    records = episodes(3, steps=6, time_to_capture=0.6)
    records += episodes(3, policy="promp", steps=6, time_to_capture=0.6)
    records += episodes(2, policy="promp", seed=1, **FAILED, steps=9, reason="base turned")
    return write_folder(tmp_path_factory.mktemp("results") / "mine", records, recorded=True)


def choose(records: list[EpisodeRecord], **asked: Any) -> EpisodeRecord:
    fields = ("env_id", "robot", "difficulty", "split", "goal", "perturbation")
    fields += ("policy", "control_mode", "seed", "episode")
    return command.choose(records, dict.fromkeys(fields) | asked)


# show ------------------------------------------------------------------------------------------------------


def test_show_prints_the_table_and_where_the_report_is(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert show([str(folder)]) == 0
    said = capsys.readouterr()
    assert "promp" in said.out and "mpc" in said.out and str(folder / "records.jsonl") in said.out
    assert "report.html" not in said.out  # there is none
    assert said.err == ""


def test_show_refuses_what_is_no_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert show([str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("evaluate.py show: ")


def test_rows_are_sorted_by_any_column_within_their_task() -> None:
    records = episodes(4, policy="gentle", final_attitude=1.0, time_to_capture=9.0, steps=90)
    records += episodes(4, policy="fast", final_attitude=3.0, time_to_capture=3.0, steps=30)
    records += episodes(4, policy="never", final_attitude=2.0, **FAILED, steps=200)
    records += episodes(4, PLANAR, policy="other", final_attitude=0.5)
    rows = build_rows(records, np.random.default_rng(0), resamples=20)
    for column, wanted in (
        ("final_attitude", ["gentle", "fast", "never", "other"]),
        ("final attitude", ["gentle", "fast", "never", "other"]),
        ("kept-attitude score", ["fast", "gentle", "never", "other"]),
        ("captures", ["fast", "gentle", "never", "other"]),
        ("rank", ["fast", "gentle", "never", "other"]),
        ("time_to_capture", ["fast", "gentle", "never", "other"]),
    ):
        assert [row.policy for row in sorted_rows(rows, column)] == wanted, column
    assert sorted_rows(rows, "success")[2].policy == "never"
    untimed = {"planning_ms": None, "action_ms": None, "processor": None, "threads": None}
    plain = [replace(r, timing=untimed) if r.policy == "fast" else r for r in records]  # type: ignore[arg-type]
    rows = build_rows(plain, np.random.default_rng(0), resamples=20)
    assert sorted_rows(rows, "planning_ms")[2].policy == "fast"
    with pytest.raises(ConfigurationError, match="unknown column 'sucess'.*Did you mean 'success'"):
        sorted_rows(rows, "sucess")


def test_tasks_are_chosen_by_their_words() -> None:
    records = episodes(1) + episodes(1, split="ood") + episodes(1, PLANAR) + episodes(1, difficulty="hard")
    assert of_tasks(records, []) == records
    assert of_tasks(records, ["DualArmPlanar-v0"]) == records[2:3]
    assert of_tasks(records, [SINGLE, "medium"]) == records[:2]
    assert of_tasks(records, ["SingleArm-v0", "ood", "test"]) == [*records[:2], records[3]]
    assert of_tasks(records, ["hard"]) == records[3:]
    with pytest.raises(ConfigurationError, match="unknown task 'SingleArm-v1'.*Did you mean 'SingleArm-v0'"):
        of_tasks(records, ["SingleArm-v1"])
    with pytest.raises(ConfigurationError, match="unknown task 'DualArmPlanar-v0 ood'"):
        of_tasks(records, ["DualArmPlanar-v0", "ood"])


# replay: which episode -------------------------------------------------------------------------------------


def test_what_is_the_only_one_need_not_be_named() -> None:
    records = episodes(3)
    assert choose(records, episode=1) is records[1]
    assert choose(records, episode=1, policy="mpc", seed=0, env_id=SINGLE) is records[1]


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, r"hold several of --env: SpaceCapture/SingleArm-v0, SpaceCapture/DualArmPlanar-v0; choose one"),
        ({"env_id": "SpaceCapture/SingleArm-v1"}, "Did you mean 'SpaceCapture/SingleArm-v0'"),
        ({"env_id": SINGLE}, "several of --split.*: test, ood; choose one"),
        ({"env_id": SINGLE, "split": "test"}, "several of --policy.*: mpc, promp; choose"),
        ({"env_id": SINGLE, "split": "test", "policy": "prmp"}, "Did you mean 'promp'"),
        ({"env_id": DUAL, "policy": "promp"}, "unknown policy 'promp'; valid are 'mpc'"),
        ({"env_id": SINGLE, "split": "ood", "seed": 9}, "no seed 9.*there are 2-4, 7"),
        ({"env_id": SINGLE, "split": "ood"}, "several of --seed.*: 2, 3, 4, 7"),
        ({"env_id": DUAL, "episode": 5}, "no episode 5 of seed 0; there are 0-2"),
    ],
)  # fmt: skip
def test_what_is_not_clear_or_not_there_is_said(asked: dict[str, Any], said: str) -> None:
    records = episodes(3) + episodes(3, policy="promp") + episodes(3, PLANAR)
    records += [record for seed in (2, 3, 4, 7) for record in episodes(1, split="ood", seed=seed)]
    with pytest.raises(ConfigurationError, match=said):
        choose(records, **{"episode": 0, **asked})


def test_the_recorded_episode_is_those_of_the_episode(folder: Path) -> None:
    results = read_folder(folder)
    record = choose(list(results.records), policy="promp", seed=1, episode=1)
    replay = command.recorded(results, record)
    assert (replay.seed, replay.episode, replay.outcome, replay.reason) == (1, 1, "timeout", "base turned")
    assert len(replay.time) == 10 and replay.scene[0, 7] == 1.0  # where the made-up episodes begin
    wanted = replay.task.goals("test", np.array([record.index]))
    np.testing.assert_array_equal(replay.goals.position, wanted.position)


def test_results_without_episodes_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = write_folder(tmp_path / "bare", episodes(2))
    assert command.main([str(bare), "--episode", "0", "--video", str(tmp_path / "a.mp4")]) == 2
    assert "bare has no recorded episodes of 'mpc' on SpaceCapture/SingleArm-v0" in capsys.readouterr().err


def test_figures_of_the_episode_are_said(folder: Path) -> None:
    record = choose(list(read_folder(folder).records), policy="promp", seed=1, episode=0)
    first, second, third = command.summary_lines(record)
    assert first.startswith(
        "promp (joint_velocity) on SpaceCapture/SingleArm-v0, shyam2020/paper, medium, test split"
    )
    assert first.endswith("episode 0 of seed 1, goal 10")
    assert second == "timeout: base turned, 9 steps"
    assert "final attitude 4.5 deg" in third and "base disturbance (eq. 20) 60 cm^2/s" in third
    none = changed(record, final_attitude=None, reason="a\x1b[31m\nb")
    assert "at the end" not in command.summary_lines(none)[2].split(";")[0]
    assert "\x1b" not in command.summary_lines(none)[1] and "\n" not in command.summary_lines(none)[1]


# replay: pictures ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_video(folder: Path, tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / f"episode{suffix}"
    given = [str(folder), "--policy", "mpc", "--episode", "2", "--video", str(target)]
    if missing_gl() is not None:
        assert command.main(given) == 2
        assert "OpenGL" in capsys.readouterr().err
        assert not list(tmp_path.iterdir())
        return
    import imageio.v3 as iio

    assert command.main(given) == 0
    said = capsys.readouterr().out
    assert "captured after 0.6 s, 6 steps" in said and str(target) in said
    frames = iio.imread(target)
    assert len(frames) == 7  # the start and six steps
    assert frames[0].std() > 10
    assert (np.abs(frames[0].astype(int) - frames[-1]) > 30).any()  # the arm turns by a little
    other = tmp_path / f"other{suffix}"
    assert command.main([*given[:-1], str(other), "--camera", "chase"]) == 0
    assert np.abs(iio.imread(other)[0].astype(int) - frames[0]).mean() > 5


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--video", "a.avi"], "unknown kind of video '.avi'; valid are '.mp4', '.gif'"),
        (["--video", "a"], "unknown kind of video ''"),
        (["--policy", "mpc", "--video", "records/a.mp4", "--camera", "overveiw"], "Did you mean 'overview'"),
    ],
)
def test_mistakes_are_one_line(
    folder: Path,
    given: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command.main([str(folder), "--episode", "0", *given]) == 2
    error = capsys.readouterr().err
    assert error.startswith("evaluate.py replay: ") and said in error and error.count("\n") == 1


def test_without_a_screen_a_video_is_suggested(
    folder: Path, fresh_trials: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(opengl.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    given = [str(folder), "--policy", "mpc", "--episode", "0"]
    assert command.main(given) == 2
    assert "no screen to open a window on; write a video instead: --video FILE.mp4" in (
        capsys.readouterr().err
    )
    monkeypatch.setenv("DISPLAY", ":9999")
    monkeypatch.setattr(opengl, "_TRIAL", "raise RuntimeError('cannot connect')")
    assert command.main(given) == 2
    said = capsys.readouterr().err
    assert "no window can be opened; write a video instead" in said and "cannot connect" in said


def test_the_window_plays_the_episode_until_it_is_closed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[np.ndarray] = []

    class Window:
        """Closed in the middle of the second time through."""

        def __init__(self, model: Any, **options: Any) -> None:
            self.model = model

        def __enter__(self) -> "Window":
            return self

        def __exit__(self, *details: object) -> None:
            shown.append(np.empty(0))

        def show(self, state: np.ndarray) -> bool:
            shown.append(state)
            return len(shown) < 25

    rests: list[float] = []
    monkeypatch.setattr(command, "has_screen", lambda: True)
    monkeypatch.setattr(command, "Renderer", Window)
    monkeypatch.setattr(command, "time", SimpleNamespace(sleep=rests.append))
    results = read_folder(folder)
    replay = command.recorded(results, choose(list(results.records), policy="mpc", episode=0))
    command.watch(replay, "overview")
    assert len(shown) == 26 and len(shown[-1]) == 0  # the window was closed
    assert rests == [command.REST]
    # Six steps with two states between each make 19, then it begins again.
    np.testing.assert_array_equal(shown[0], shown[19])
    assert np.all(np.diff([state[0] for state in shown[:19]]) > 0)  # time

    def fails(*_: object) -> bool:
        raise RenderingError("no driver")

    monkeypatch.setattr(Window, "show", fails)
    with pytest.raises(RenderingError, match=r"no window can be opened.*--video FILE\.mp4 \(no driver\)"):
        command.watch(replay, "overview")
