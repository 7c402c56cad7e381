"""Whatever comes from a policy of a stranger loses that policy its episodes, and nothing else."""

import gc
import os
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.commands.evaluate import main
from agents.policies.registry import make_policy
from agents.policies.resolve import resolve_policy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import PolicyError
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.process.policy_process import PolicyProcess
from space_envs.evaluation.play.steps import predicted
from space_envs.evaluation.records.storage import read_records
from space_envs.foreign_code import described
from space_envs.policy import PolicyContext

SINGLE = "SpaceCapture/SingleArm-v0"
JOINTS = 7


class Unspeakable(Exception):
    """An exception whose message raises."""

    def __str__(self) -> str:
        raise RuntimeError("no words")

    __repr__ = __str__


class Returns:
    """Returns what is asked for, or does it, in `what` and `misbehave`."""

    what: Any = None

    def __init__(self, context: PolicyContext, seed: int) -> None:
        self.size = len(context.action_scale)

    def misbehave(self, observation: np.ndarray) -> Any:
        return self.what

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self.misbehave(observation)


def rows(observation: np.ndarray, **keywords: Any) -> np.ndarray:
    return np.zeros((len(observation), JOINTS), **keywords)


class Mutating(np.ndarray):
    """An array that says that it has another shape."""

    shape = property(lambda self: (1, JOINTS))  # type: ignore[assignment]


def raising(error: BaseException) -> Any:
    def misbehave(self: Returns, observation: np.ndarray) -> Any:
        raise error

    return misbehave


def giving(make: Any) -> Any:
    return lambda self, observation: make(observation)


HOSTILE: dict[str, tuple[Any, str]] = {
    "unspeakable": (raising(Unspeakable()), "it raised an exception that cannot be shown"),
    "generator exit": (raising(GeneratorExit()), "it raised GeneratorExit:"),
    "system exit": (raising(SystemExit(4)), "it raised SystemExit: 4"),
    "base": (raising(BaseException("enough")), "it raised BaseException: enough"),
    "lines": (raising(ValueError("a\nb\ud800\x00")), "it raised ValueError: a b?\x00"),
    "long": (raising(ValueError("x" * 10**6)), "it raised ValueError: " + "x" * 900),
    "complex": (giving(lambda o: (rows(o) + 1j, None)), "it returned actions of type complex128"),
    "objects": (giving(lambda o: (rows(o).astype(object), None)), "it returned actions of type object"),
    "texts": (giving(lambda o: (rows(o).astype(str), None)), "it returned actions of type <U32"),
    "bools": (giving(lambda o: (rows(o, dtype=bool), None)), "it returned actions of type bool"),
    "generator": (giving(lambda o: ((x for x in o), None)), "it returned actions of type object"),
    "none": (giving(lambda o: None), "it returned a NoneType, expected a pair"),
    "bare": (giving(rows), "it returned a ndarray, expected a pair"),
    "triple": (giving(lambda o: (rows(o), None, None)), "it returned a tuple of 3, expected a pair"),
    "ragged": (giving(lambda o: ([[1.0], [1.0, 2.0]], None)), "it raised ValueError: "),
    "huge": (giving(lambda o: (np.broadcast_to(0.0, (10**9, JOINTS)), None)), "it returned actions of shape"),
    "other shape": (
        giving(lambda o: (np.zeros((3, JOINTS)).view(Mutating), None)),
        "actions of shape (3, 7)",
    ),
}
CLASSES = {
    name: type(f"Hostile{number}", (Returns,), {"misbehave": misbehave})
    for number, (name, (misbehave, _)) in enumerate(HOSTILE.items())
}
globals().update({kind.__name__: kind for kind in CLASSES.values()})


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_action_is_a_reason(name: str) -> None:
    policy = CLASSES[name](PolicyContext.from_env(CaptureVectorEnv()), 0)
    with warnings.catch_warnings(action="error"), pytest.raises(PolicyError) as caught:
        predicted(policy, np.zeros((1, 60)), None, np.array([True]), JOINTS)
    assert HOSTILE[name][1] in str(caught.value)
    assert len(str(caught.value)) < 1200


@pytest.mark.parametrize("name", ["unspeakable", "generator exit", "complex", "huge", "lines"])
def test_the_same_in_a_process_of_its_own(name: str) -> None:
    policy = resolve_policy(f"{__name__}:{CLASSES[name].__name__}")
    assert policy.foreign
    found = roll_out(policy.factory(0), {"env_id": SINGLE}, "test", np.arange(2), 0, apart=True)
    assert found.outcome.tolist() == ["policy_error"] * 2
    assert all(reason is not None and HOSTILE[name][1] in reason for reason in found.reason)


def test_ctrl_c_is_the_users_and_a_stranger_cannot_raise_it() -> None:
    hostile = type("Interrupts", (Returns,), {"misbehave": raising(KeyboardInterrupt())})
    policy = hostile(PolicyContext.from_env(CaptureVectorEnv()), 0)
    with pytest.raises(KeyboardInterrupt):
        predicted(policy, np.zeros((1, 60)), None, np.ones(1, bool), JOINTS)
    environment = {"env_id": SINGLE}
    found = roll_out(lambda context: hostile(context, 0), environment, "test", np.arange(1), 0, apart=True)
    assert found.reason.tolist() == ["it raised KeyboardInterrupt: (step 0)"]


def test_an_action_that_changes_later_is_the_one_that_was_given() -> None:
    kept: list[np.ndarray] = []

    class Changes(Returns):
        def misbehave(self, observation: np.ndarray) -> Any:
            kept.append(np.full((1, JOINTS), 0.5))
            observation[:] = np.nan  # its own copy
            return kept[0], None

    observation = np.zeros((1, 60))
    policy: Any = Changes(PolicyContext.from_env(CaptureVectorEnv()), 0)
    action, _ = predicted(policy, observation, None, np.array([True]), JOINTS)
    kept[0][:] = 9.0
    assert (action == 0.5).all()
    assert (observation == 0.0).all()


class Cheats(Returns):
    """Looks for the environment in everything that there is, and says that it captured."""

    def misbehave(self, observation: np.ndarray) -> Any:
        objects, self.what = ([] if self.what else gc.get_objects()), "once"
        for found in objects:
            if type(found).__name__ == "CaptureVectorEnv":
                found.simulation.qpos[:] = np.nan
                found.step = lambda action: os._exit(7)
        return rows(observation), None


class Chaotic(Returns):
    """Changes everything of its process that it can."""

    def misbehave(self, observation: np.ndarray) -> Any:
        os.chdir("/")
        os.umask(0o777)
        os.environ.clear()
        sys.path.clear()
        np.seterr(all="raise")
        warnings.simplefilter("error")
        np.random.seed(0)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        os.closerange(0, 3)
        sys.stdout = sys.stderr = None
        return rows(observation), None


class Exits(Returns):
    """Ends its process at once."""

    def misbehave(self, observation: np.ndarray) -> Any:
        os._exit(0)


class Answers(Returns):
    """Writes an answer of its own into every pipe that it has."""

    def misbehave(self, observation: np.ndarray) -> Any:
        for number in range(3, 64):
            try:
                os.write(number, b"\xff" * 4096)
            except OSError:
                pass
        time.sleep(60.0)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Exits", "its process ended, with exit status 0 (step 0)"),
        ("Answers", "its process answered in a way that no policy can by itself (step 0)"),
    ],
)
def test_a_stranger_that_breaks_its_process_loses_its_episodes(name: str, reason: str) -> None:
    policy = resolve_policy(f"{__name__}:{name}")
    found = roll_out(policy.factory(0), {"env_id": SINGLE}, "test", np.arange(1), 0, apart=True)
    assert found.reason.tolist() == [reason]


@pytest.mark.usefixtures("brief_reports")
def test_a_stranger_reaches_neither_the_environment_nor_the_harness(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one job, where the harness plays in this process; results come to where they were asked for."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    policies = [f"{__name__}:Cheats", f"{__name__}:Chaotic", "hold"]
    arguments = ["--policy", *policies, "--episodes", "2", "--no-pictures", "--jobs", "1"]
    assert main([*arguments, "--output", "out"]) == 0
    records = read_records(tmp_path / "out" / "records.jsonl")
    hold = records[4:]
    for mine in (records[:2], records[2:4]):
        assert [record.reason for record in mine] == [None] * 2
        for one, other in zip(mine, hold, strict=True):  # it did nothing, as far as its episodes go
            assert (one.outcome, one.metrics) == (other.outcome, other.metrics)
    assert Path.cwd() == tmp_path
    assert os.environ.get("PATH")
    assert (tmp_path / "out" / "report.html").stat().st_mode & 0o400


def module_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str) -> str:
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


def test_a_module_that_changes_the_process_when_it_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = (os.getcwd(), dict(os.environ), np.geterr(), signal.getsignal(signal.SIGTERM), sys.stdout)
    text = "import os, sys, signal, numpy as np, warnings\nos.chdir('/')\nos.umask(0o777)\n"
    text += "os.environ['PATH'] = ''\nnp.seterr(all='raise')\nsys.stdout = None\n"
    text += "signal.signal(signal.SIGTERM, signal.SIG_IGN)\nwarnings.simplefilter('error')\nclass A:\n"
    text += "    def predict(self): pass\n"
    resolve_policy(module_of(tmp_path, monkeypatch, "chaotic_module", text) + ":A")
    assert before == (
        os.getcwd(),
        dict(os.environ),
        np.geterr(),
        signal.getsignal(signal.SIGTERM),
        sys.stdout,
    )
    (tmp_path / "file").write_text("")
    assert (tmp_path / "file").stat().st_mode & 0o400


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise SystemExit(3)", "cannot be imported: SystemExit: 3"),
        ("raise GeneratorExit", "cannot be imported: GeneratorExit:"),
        ("class E(Exception):\n def __str__(self): raise E\n __repr__ = __str__\nraise E", "cannot be shown"),
        ("def __getattr__(name): raise BaseException('no')", "cannot be imported: BaseException: no"),
        ("class M(type):\n @property\n def predict(self): raise BaseException('no')\nclass A(metaclass=M): 0",
         "cannot be imported: BaseException: no"),
        ("class A:\n control_mode = 'joint_velocty'\n def predict(self): 0", "Did you mean 'joint_velocity'"),
        ("class A:\n control_mode = 3\n def predict(self): 0", "unknown control mode <class 'int'>"),
    ],
)  # fmt: skip
def test_modules_that_cannot_be_used_say_so(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = module_of(tmp_path, monkeypatch, f"bad_module_{abs(hash(text))}", text + "\n")
    with pytest.raises(PolicyError, match=said):
        resolve_policy(f"{name}:A")


class Unborn(Returns):
    """Raises where it is built."""

    def __init__(self, context: PolicyContext, seed: int) -> None:
        raise GeneratorExit


def test_a_policy_that_raises_anything_where_it_is_built() -> None:
    context = PolicyContext.from_env(CaptureVectorEnv())
    with pytest.raises(PolicyError, match="could not be built with .*GeneratorExit"):
        make_policy(f"{__name__}:Unborn", context, 0)
    policy = resolve_policy(f"{__name__}:Unborn")
    with (
        pytest.raises(PolicyError, match="could not be built with .*GeneratorExit"),
        PolicyProcess(policy.factory(0), {"env_id": SINGLE}) as process,
    ):
        process.build()


def test_exceptions_are_described_whatever_they_are() -> None:
    class Named(type):
        @property
        def __name__(cls) -> str:  # type: ignore[override]
            raise RuntimeError

    class Hidden(Exception, metaclass=Named):
        pass

    assert described(Hidden()) == "an exception that cannot be shown"
    assert described(ValueError("a\n  b")) == "ValueError: a b"
    described(ValueError("\ud800")).encode("utf-8")
