"""`evaluate.py replay`: look at a recorded episode in MuJoCo's viewer, or write a video of it."""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError, RenderingError, unknown_name
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.replay.frames import model_states
from space_envs.evaluation.replay.replay import Replay, replay_of
from space_envs.evaluation.replay.videos import write_video
from space_envs.evaluation.results.folders import ResultFolder, read_folder
from space_envs.registration import find
from space_envs.rendering import Renderer
from space_envs.system.command_line import Parser, check_replaceable, exit_status, output_path
from space_envs.system.opengl import has_screen

SUFFIXES = (".mp4", ".gif")
REST = 1.5  # s, pause at the end before the motion starts again
SMOOTH = 3  # states shown for each recorded step
DESCRIPTION = """\
Look at a recorded episode in MuJoCo's viewer, in real time, repeated until the window is closed, or write a
video of it. Policy, seed, id and the like are needed only if the results hold several; an id that another
package registers is always needed, as module:id.

  evaluate.py replay results/mine --policy promp --episode 3
  evaluate.py replay results/mine --policy promp --episode 3 --video capture.mp4
"""
# Option -> field of a record, its name in messages and its type, in the order in which records are selected.
_CHOICES: dict[str, tuple[str, str, type]] = {
    "env": ("env_id", "environment id", str),
    "robot": ("robot", "robot", str),
    "difficulty": ("difficulty", "difficulty", str),
    "split": ("split", "split", str),
    "goal": ("goal", "kind of goal", str),
    "perturbation": ("perturbation", "perturbation", str),
    "policy": ("policy", "policy", str),
    "control-mode": ("control_mode", "control mode", str),
    "seed": ("seed", "seed", int),
    "episode": ("episode", "episode", int),
}


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(
        prog="evaluate.py replay",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    out.add_argument("results", type=Path, metavar="RESULTS", help="result folder of evaluate.py")
    out.add_argument("--episode", type=int, required=True, metavar="K", help="number within policy and seed")
    for option, (_, what, kind) in _CHOICES.items():
        if option != "episode":
            out.add_argument(f"--{option}", type=kind, metavar=kind.__name__.upper(), help=what)
    what = f"write a video instead of opening a window ({', '.join(SUFFIXES)})"
    out.add_argument("--video", type=output_path, metavar="FILE", help=what)
    out.add_argument("--overwrite", action="store_true", help="replace an existing video")
    what = "of the model to look through (default %(default)s)"
    out.add_argument("--camera", default="overview", metavar="NAME", help=what)
    return out


def main(arguments: list[str]) -> int:
    """Run the command; returns the exit status."""
    return exit_status("evaluate.py replay", lambda: _run(parser().parse_args(arguments)))


def _run(options: argparse.Namespace) -> None:
    if options.video is not None:
        if options.video.suffix not in SUFFIXES:
            raise unknown_name("kind of video", options.video.suffix, SUFFIXES)
        check_replaceable(options.video, options.overwrite)
    folder = read_folder(options.results)
    if options.env is not None and ":" in options.env:
        options.env = find(options.env).id
    selection = {
        field: getattr(options, option.replace("-", "_")) for option, (field, _, _) in _CHOICES.items()
    }
    record = choose(folder.records, selection)
    replay = recorded(folder, record)
    for line in summary_lines(record):
        print(line)
    if options.video is None:
        watch(replay, options.camera)
    else:
        write_video(replay, options.video, options.camera)
        print(f"Video: {options.video}")


def choose(records: Sequence[EpisodeRecord], selection: dict[str, Any]) -> EpisodeRecord:
    """The one record that fits the selection.

    Args:
        selection: value of each field by which records are selected; None if it was not given.

    Raises:
        ConfigurationError: for a value that no record has, or if several records fit.
    """
    remaining, chosen = list(records), ""
    for option, (field, what, kind) in _CHOICES.items():
        values = list(dict.fromkeys(getattr(record, field) for record in remaining))
        value = selection[field]
        if value is None and len(values) > 1:
            shown = ", ".join(display_name(str(each)) for each in values)
            raise ConfigurationError(f"the results hold several of --{option}{chosen}: {shown}; choose one")
        if value is not None and value not in values:
            if kind is str:
                raise unknown_name(what, value, values)
            raise ConfigurationError(f"there is no {what} {value}{chosen}; there are {_ranges(values)}")
        value = values[0] if value is None else value
        remaining = [record for record in remaining if getattr(record, field) == value]
        chosen = f" of {what} {value}" if kind is int else f" of {value}"
    return remaining[0]


def recorded(folder: ResultFolder, record: EpisodeRecord) -> Replay:
    """Replay of a record's episode.

    Raises:
        ConfigurationError: if the folder has no episodes, or they are of another version of the task.
    """
    episodes = folder.episodes(record.entry)
    if episodes is None:
        raise ConfigurationError(
            f"{folder.path} has no recorded episodes of {record.policy!r} on {record.entry.task}; they are "
            "written by evaluate.py"
        )
    row = episodes.row(record.seed, record.episode)
    return replay_of("", row, episodes.task(), episodes, record)


def summary_lines(record: EpisodeRecord) -> list[str]:
    """Outcome and metrics of an episode, as lines for the terminal."""
    reason = f": {display_name(record.explanation, 200)}" if record.explanation else ""
    time, steps = record.metrics["time_to_capture"], record.metrics["steps"]
    seconds = "" if time is None else f" after {time:.1f} s"
    figures = (
        ("final attitude", "final_attitude", 1.0, "deg"),
        ("peak", "peak_attitude", 1.0, "deg"),
        ("base disturbance (eq. 20)", "attitude_cost", 1e4, "cm^2/s"),
        ("final position error", "position_error", 1e3, "mm"),
        ("work", "mechanical_work", 1.0, "J"),
    )
    shown = [
        f"{title} {scale * value:.3g} {unit}"
        for title, name, scale, unit in figures
        if (value := record.metrics[name]) is not None
    ]
    return [
        f"{display_name(record.policy)} ({record.control_mode}) on {record.entry.task}: "
        f"episode {record.episode} of seed {record.seed}, goal {record.index}",
        f"{record.outcome}{seconds}{reason}, {steps} steps",
        "; ".join(shown),
    ]


def watch(replay: Replay, camera: str) -> None:
    """Show an episode in a window in real time, repeated until the window is closed.

    Raises:
        RenderingError: if no window can be opened.
        ConfigurationError: for an unknown camera.
    """
    advice = "write a video instead: --video FILE.mp4"
    with Renderer(replay.task.render_model, camera=camera) as renderer:
        if not has_screen():
            raise RenderingError(f"no screen to open a window on; {advice}")
        states = list(model_states(replay, renderer.model, SMOOTH))
        try:
            while all(renderer.show(state) for state in states):
                time.sleep(REST)
        except RenderingError as error:
            raise RenderingError(f"no window can be opened; {advice} ({error})") from error


def _ranges(values: Sequence[int]) -> str:
    """Whole numbers as 0-4, 7."""
    runs: list[list[int]] = []
    for value in sorted(values):
        if runs and value == runs[-1][-1] + 1:
            runs[-1] = [runs[-1][0], value]
        else:
            runs.append([value, value])
    return ", ".join(str(low) if low == high else f"{low}-{high}" for low, high in runs)
