"""The benchmarks' command lines: what they refuse, what they list, what they write."""

import re
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from offenders import assert_none
from robot_descriptions import SIX_JOINTS

from benchmarks import limits, planners, simulated
from benchmarks.__main__ import main, names
from space_envs.errors import ConfigurationError

ROOT = Path(__file__).parents[1]
NUMBERS = {
    "attitude_cost": ("--trajectories", "--points", "--repeats"),
    "brackets": ("--configurations",),
    "limits": ("--episodes",),
    "mismatch": ("--goals",),
    "momentum": ("--episodes",),
    "moving_goals": ("--goals",),
    "optimal": ("--goals", "--jobs"),
    "planner_networks": ("--goals",),
    "planners": ("--episodes",),
    "planning": ("--goals",),
    "reactionless_collocation": ("--goals",),
    "reactionless_energies": ("--goals",),
    "reactionless_paths": ("--goals", "--horizon"),
    "returns": (),
    "robot_figures": (),
    "robots": ("--goals",),
    "robustness": ("--episodes",),
    "shooting": ("--goals",),
    "speed": ("--rounds",),
    "stochastic_feedback": ("--goals", "--episodes"),
    "tracking": ("--goals",),
}


def refusal(name: str, arguments: list[str], monkeypatch, capsys) -> str:
    """Message with which a benchmark refuses arguments."""
    monkeypatch.setattr(sys, "argv", [f"benchmarks/{name}.py", *arguments])
    with pytest.raises(SystemExit) as exit_:
        import_module(f"benchmarks.{name}").main()
    assert exit_.value.code == 2
    return capsys.readouterr().err


def test_numbers_are_checked_before_anything_runs(monkeypatch, capsys) -> None:
    assert set(NUMBERS) == set(names())
    assert_none(
        f"{name} {option}={value}: {message}"
        for name, options in NUMBERS.items()
        for option in options
        for value in ("-1", "0", "1.5", "nan", "1e3", "", str(10**30))
        if f"python -m benchmarks.{name}: error: argument {option}: must be a whole number from 1 to"
        not in (message := refusal(name, [f"{option}={value}"], monkeypatch, capsys))
    )


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("planners", ["--env", "Foo"], "unknown environment id 'Foo'"),
        ("planners", ["--env", "SpaceCapture/SingleArm-v1"], "Did you mean 'SpaceCapture/SingleArm-v0'"),
        ("planners", ["--split", "tset"], "Did you mean 'test'"),
        ("planners", ["--goals", "axes"], "Did you mean 'axis'"),
        ("mismatch", ["--split", "tset"], "Did you mean 'test'"),
        ("optimal", ["--split", "tset"], "Did you mean 'test'"),
        ("speed", ["--reference", "nothere"], "must be a program that can be run, got 'nothere'"),
        ("momentum", ["--seed=-1"], "argument --seed: must be a whole number"),
    ],
)
def test_names_are_checked_and_the_nearest_is_named(
    name: str, arguments: list[str], message: str, monkeypatch, capsys
) -> None:
    assert message in refusal(name, arguments, monkeypatch, capsys)


@pytest.mark.parametrize(
    "name", ["mismatch", "optimal", "planning", "shooting", "stochastic_feedback", "tracking"]
)
def test_more_goals_than_a_split_has_are_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [f"benchmarks/{name}.py", "--goals", "9999"])
    for work in {"play", "simulated_errors", "evaluation_time"} & set(
        vars(module := import_module(f"benchmarks.{name}"))
    ):
        monkeypatch.setattr(module, work, lambda *_: pytest.fail("work before the refusal"))
    with pytest.raises(ConfigurationError, match="has (256|512) goals, so --goals must be at most"):
        module.main()


def test_robots_that_are_unknown_or_do_not_fit_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = "SpaceCapture/SingleArm-v0", "SpaceCapture/DualArmPlanar-v0"
    for robot, message in (
        ("ets", dict.fromkeys(("mismatch", "planners", "speed", "tracking"), "Did you mean 'ets_vii'")),
        ("shah2013", dict.fromkeys(("mismatch", "planners"), f"{one} needs a robot with one arm")),
        ("ets_vii", {"tracking": f"the robot fits no id: {two} needs a robot with two arms"}),
    ):
        for name, said in message.items():
            monkeypatch.setattr(sys, "argv", [f"benchmarks/{name}.py", "--robot", robot])
            with pytest.raises(ConfigurationError, match=said):
                import_module(f"benchmarks.{name}").main()


def test_limits_of_any_robot(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(SIX_JOINTS)
    mine, planar = simulated.simulated_robots([str(file), "shah2013"])
    assert (mine.name, mine.env_id) == ("mine", "SpaceCapture/SingleArm-v0")
    assert (planar.name, planar.env_id) == ("shah2013", "SpaceCapture/DualArmPlanar-v0")
    found = limits.run(mine, "joint_velocity", 0.1, 0.0125, 2, 0)
    assert 0.0 < found.drift <= 1e-6 and 0.5 < found.rate < 1.5 and found.distance > 0.05
    assert simulated.simulated_robots([]) == simulated.ROBOTS


def test_wider_limits_are_of_the_benchmark_alone() -> None:
    robot = simulated.ROBOTS[0]
    tried = simulated.unlimited(robot)
    env = simulated.environment(tried, "joint_velocity", 2, 0, control_period=1.0, timestep=0.05)
    motion = simulated.simulate(env, [np.ones(env.action_space.shape)] * 3)
    assert motion.qpos.shape[:2] == (2, 4) and motion.torques.shape[:2] == (2, 3) and not motion.diverged
    with pytest.raises(ConfigurationError, match="timestep must lie in"):
        simulated.environment(robot, "joint_velocity", 2, 0, timestep=0.05)


def test_the_list_is_a_line_for_each_with_a_gap_after_the_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0] for line in lines] == names()
    assert len({len(line) - len(line.split("  ", 1)[1].lstrip()) for line in lines}) == 1


def test_an_unknown_benchmark_gets_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["planer"])
    assert "Did you mean 'planners'" in capsys.readouterr().err


def test_the_plots_go_to_the_output_folder_unless_they_are_sent_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped = ROOT / "docs/images/planners.svg"
    before = shipped.read_bytes()
    figure = {"value": 1.0}
    keys = ("attitude_cost", "final_attitude", "peak_attitude", "time_to_capture", "success")
    keys += ("capture@0.1deg",)
    row = {"policy": "mpc", "timing": {"planning_ms": 8.0}, "figures": dict.fromkeys(keys, figure)}
    row["captures"] = 3
    missing = {key: {"value": None if "@" not in key and key != "success" else 0.0} for key in keys}
    never = {"policy": "never", "timing": {"planning_ms": 8.0}, "figures": missing, "captures": 0}
    monkeypatch.setattr(planners, "summary", lambda *_: [row, never])
    for arguments, path in ((["--plots", str(tmp_path / "own")], "own"), ([], "out")):
        monkeypatch.setattr(sys, "argv", ["planners.py", "--output", str(tmp_path / "out"), *arguments])
        (tmp_path / path).mkdir()
        planners.main()
        names = sorted(file.name for file in (tmp_path / path).iterdir())
        assert names == ["peak_attitude.svg", "planners.svg"]
    assert shipped.read_bytes() == before
    monkeypatch.setattr(
        planners, "summary", lambda *given: [one | {"goal": given[4]["goal"]} for one in (never, row)]
    )
    monkeypatch.setattr(sys, "argv", ["planners.py", "--goals", "pose", "axis"])
    capsys.readouterr()
    planners.main()
    lines = [line.split("|")[1:3] for line in capsys.readouterr().out.splitlines()[2:6]]
    assert [" ".join(cell.strip() for cell in line) for line in lines] == [
        "mpc pose",
        "mpc axis",
        "never pose",
        "never axis",
    ]


def test_figure_of_planners_shows_what_its_caption_says(tmp_path: Path) -> None:
    def row(policy: str, kept: float) -> dict:
        figures = {key: {"value": 0.01 * len(policy)} for key in ("attitude_cost", "final_attitude")}
        figures["capture@0.1deg"] = {"value": kept}
        return {"policy": policy, "timing": {"planning_ms": 10.0 * len(policy)}, "figures": figures}

    rows = [row("ocp", 0.0), row("nmpc", 0.99), row("mpc_of_a_kind", 0.2)]
    planners.draw(rows, planners.FIGURES["planners"], tmp_path / "one.svg")
    text = (tmp_path / "one.svg").read_text(encoding="utf-8")
    markers = re.findall(r'<path id="[^"]+" d="([^"]+)" style="stroke: (#[0-9a-f]{6})', text)
    # A circle is made of curves, a square of lines.
    shapes = {color: "square" if "C" not in path else "circle" for path, color in markers}
    assert shapes[planners.VERMILION] == "square" and shapes[planners.BLUE] == "circle"
    # In two panels and in the legend.
    uses = [text.count(f'style="fill: {color}') for color in (planners.VERMILION, planners.BLUE)]
    assert uses == [3, 5]
    for name, caption in (
        ("README.md", planners.PEAK_CAPTION),
        ("docs/reactionless.md", planners.PEAK_CAPTION),
        ("docs/optimal.md", planners.CAPTION),
    ):
        assert f"![{caption}](" in (ROOT / name).read_text(encoding="utf-8")
