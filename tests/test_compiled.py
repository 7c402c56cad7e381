"""Compiled code: numpy's numbers, a cache that survives damage, a fall-back with one warning."""

import ctypes
import os
import shutil
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from dynamics_models import ROBOTS, robot_and_model

from space_envs.codegen import functions, libraries, once
from space_envs.dynamics import FloatingRobot, NoCompiledCodeWarning, base_twist, trajectory_cost
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError

quiet = pytest.mark.filterwarnings("ignore::space_envs.dynamics.NoCompiledCodeWarning")
HAS_COMPILER = any(map(shutil.which, [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]))
needs_owners = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As in a new process with an empty cache."""
    once.clear()
    libraries.warn_uncompiled.cache_clear()
    monkeypatch.setenv("SPACE_ENVS_CACHE", str(tmp_path / "cache"))


@pytest.fixture(params=["compiled", "numpy"])
def implementation(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "numpy":
        monkeypatch.setenv("CC", "no-such-compiler")
    return request.param


def samples(name: str, *shape: int) -> tuple[Array, Array]:
    n = robot_and_model(name)[0].n_joints
    rng = np.random.default_rng(3)
    return rng.uniform(-4.0, 4.0, (*shape, n)), rng.normal(size=(*shape, n))


@quiet
@pytest.mark.parametrize("name", ROBOTS)
def test_same_numbers_as_numpy(name: str) -> None:
    robot, _ = robot_and_model(name)
    q, qdot = samples(name, 20, 30)
    twist = base_twist(robot, q, qdot)
    np.testing.assert_allclose(twist, robot.base_twist(q, qdot), rtol=0.0, atol=1e-12)


@quiet
def test_results_do_not_depend_on_the_batch(implementation: str) -> None:
    robot, _ = robot_and_model("single arm")
    q, qdot = samples("single arm", 40, 100)
    twist, cost = base_twist(robot, q, qdot), trajectory_cost(robot, q, qdot, 0.1)
    np.testing.assert_array_equal(base_twist(robot, q[3, 4], qdot[3, 4]), twist[3, 4])
    np.testing.assert_array_equal(base_twist(robot, q[::3, 7], qdot[::3, 7]), twist[::3, 7])
    np.testing.assert_array_equal(base_twist(robot, q[:, :1], qdot[:, :1]), twist[:, :1])
    np.testing.assert_array_equal(trajectory_cost(robot, q[5:8], qdot[5:8], 0.1), cost[5:8])
    np.testing.assert_array_equal(trajectory_cost(robot, q[5], qdot[5], 0.1), cost[5])


@quiet
def test_any_layout_of_arrays(implementation: str) -> None:
    robot, _ = robot_and_model("single arm")
    q, qdot = samples("single arm", 6, 5)
    twist = base_twist(robot, q, qdot)
    q.setflags(write=False)
    misaligned = np.frombuffer(b"x" + q.tobytes(), np.uint8)[1:].view(np.float64).reshape(q.shape)
    for other in (np.asfortranarray(q), misaligned, q.tolist(), q[::-1][::-1], q.astype(">f8")):
        np.testing.assert_array_equal(base_twist(robot, other, qdot), twist)
    broadcast = base_twist(robot, q[:, :1], qdot)
    np.testing.assert_array_equal(broadcast[:, 2], base_twist(robot, q[:, 0], qdot[:, 2]))
    assert base_twist(robot, q[:0], qdot[:0]).shape == (0, 5, 6)
    assert np.isnan(base_twist(robot, np.full(7, np.nan), qdot[0, 0])).all()
    with pytest.raises(ConfigurationError, match="joint rates"):
        base_twist(robot, q, qdot[..., :3])


@pytest.mark.parametrize("lacking", ["compiler", "any compiler", "cache", "home"])
def test_fall_back_warns_once_with_the_reason(
    lacking: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if lacking == "compiler":
        monkeypatch.setenv("CC", "no-such-compiler -O2")
        message = r"no C compiler was found \(CC=no-such-compiler\)"
    elif lacking == "any compiler":
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
        message = r"no C compiler was found \(cc, gcc, clang\)"
    elif lacking == "cache":
        (tmp_path / "file").touch()
        monkeypatch.setenv(
            "SPACE_ENVS_CACHE", str(tmp_path / "file" / "cache")
        )  # root may write anywhere else
        message = "cache of compiled code cannot be used .* set SPACE_ENVS_CACHE"
    else:
        monkeypatch.delenv("SPACE_ENVS_CACHE")
        monkeypatch.setattr(Path, "home", raise_runtime_error)
        message = "no home folder .* set SPACE_ENVS_CACHE"
    with pytest.warns(NoCompiledCodeWarning, match=message) as caught:
        use_every_robot_twice()
    assert len(caught) == 1
    assert issubclass(NoCompiledCodeWarning, RuntimeWarning)


def use_every_robot_twice() -> None:
    for name in (*ROBOTS, *ROBOTS):
        robot, _ = robot_and_model(name)
        q, qdot = samples(name, 4)
        np.testing.assert_array_equal(base_twist(robot, q, qdot), robot.base_twist(q, qdot))


def raise_runtime_error() -> Path:
    raise RuntimeError("Could not determine home directory.")


def test_wrong_code_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, _ = robot_and_model("single arm")

    class Zeros:
        @staticmethod
        def map_base_twist(inputs: ctypes.Array, outputs: ctypes.Array, count: int) -> None:
            np.ctypeslib.as_array((ctypes.c_double * (6 * count)).from_address(outputs[0]))[:] = 0.0

    monkeypatch.setattr(functions, "load_library", lambda source, native: Zeros)
    with pytest.warns(NoCompiledCodeWarning, match="disagrees with numpy"):
        twist = base_twist(robot, *samples("single arm", 3))
    assert (twist != 0.0).all()


@quiet
def test_batches_compiled_and_interpreted() -> None:
    """Both give what one sample after the other gives; a matrix comes out transposed."""
    twist = SymbolicRobot(robot_and_model("single arm")[0]).base_map
    q, _ = samples("single arm", 3, 4)
    fast, slow = functions.batched({"map": twist})["map"], functions.Batched(twist)
    assert (fast.compiled, slow.compiled) == (HAS_COMPILER, False)
    expected = np.array([[twist(one).full().T for one in row] for row in q])
    for function in (fast, slow):
        np.testing.assert_allclose(function(q)[0], expected, rtol=1e-12, atol=1e-12)
        assert function(q[:0])[0].shape == (0, 4, 7, 6)
        with pytest.raises(ValueError, match="shape"):
            function(q[..., :6])
    outside = functions.compiled({"map": twist})["map"]
    assert outside.is_a("External") == HAS_COMPILER
    np.testing.assert_allclose(outside(q[0, 0]).full().T, expected[0, 0], rtol=1e-12, atol=1e-12)


@needs_owners
@pytest.mark.filterwarnings("ignore::space_envs.codegen.cache.UnsafeCacheWarning")
def test_without_a_private_folder_numpy_takes_over(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for folder in (tmp_path / "cache", tmp_path / f"space_envs-{os.geteuid()}"):
        folder.mkdir()
        folder.chmod(0o777)
    robot, _ = robot_and_model("single arm")
    with pytest.warns(NoCompiledCodeWarning, match="can be written to by others"):
        twist = base_twist(robot, *samples("single arm", 3))
    np.testing.assert_array_equal(twist, robot.base_twist(*samples("single arm", 3)))


def test_things_are_built_once_for_equal_content_by_all_threads() -> None:
    robots = [robot_and_model(name)[0] for name in ROBOTS]
    built = []

    @once.built_once
    def slowly(robot: FloatingRobot, size: int = 1) -> object:
        built.append((robot.fingerprint, size))
        time.sleep(0.02)
        return object()

    threads = [threading.Thread(target=slowly, args=(robot,)) for robot in 4 * robots]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(built) == sorted((robot.fingerprint, 1) for robot in robots)
    assert slowly(robots[0]) is slowly(replace(robots[0])) is not slowly(robots[0], 2)


@quiet
def test_eight_samples_at_once_have_the_bits_of_one() -> None:
    """Whatever their number; what cannot be vectorised is refused."""
    twist = SymbolicRobot(robot_and_model("single arm")[0]).base_twist
    rates = samples("single arm", 13)
    fast = functions.batched({"twist": twist})["twist"](*rates)[0]
    wide = functions.batched({"twist": twist}, vectorise=True)["twist"]
    for count in (1, 8, 13):
        found = wide(*[x[:count] for x in rates])[0]
        assert np.array_equal(found, fast[:count]) if HAS_COMPILER else np.allclose(found, fast[:count])
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match="has an operation without a vector"):
        functions.batched({"f": ca.Function("f", [x], [ca.exp(x)])}, vectorise=True)
