"""Compiled code: numpy's numbers, a cache that survives damage, a fall-back with one warning."""

import ctypes
import hashlib
import os
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dynamics_models import ROBOTS, robot_and_model

from space_envs.codegen import functions, libraries, once
from space_envs.codegen.cache import (
    LibraryError,
    UnsafeCacheError,
    UnsafeCacheWarning,
    cache_folder,
    private_folder,
)
from space_envs.codegen.libraries import load_library
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
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "numpy":
        monkeypatch.setenv("CC", "no-such-compiler")
    return request.param


@pytest.fixture
def counting_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[], int]:
    """A stand-in for the compiler that copies a library of Python's; returns how often it has compiled.

    So the cache is tested on machines without a compiler too.
    """
    modules = [sys.modules[name] for name in sorted(sys.modules) if name.startswith("numpy.random.")]
    files = [getattr(module, "__file__", None) or "" for module in modules]
    library = next(file for file in files if file.endswith((".so", ".pyd")))
    log, script = tmp_path / "log", tmp_path / "compiler.py"
    script.write_text(
        "import pathlib, shutil, sys\n"
        "if '--version' in sys.argv: sys.exit(print('stand-in 1'))\n"
        f"pathlib.Path({str(log)!r}).open('a').write('x')\n"
        f"shutil.copy({library!r}, sys.argv[sys.argv.index('-o') + 1])\n"
    )
    monkeypatch.setenv("CC", f"'{sys.executable}' '{script}'")
    return lambda: len(log.read_text()) if log.exists() else 0


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
def test_results_do_not_depend_on_the_batch(way: str) -> None:
    robot, _ = robot_and_model("single arm")
    q, qdot = samples("single arm", 40, 100)
    twist, cost = base_twist(robot, q, qdot), trajectory_cost(robot, q, qdot, 0.1)
    np.testing.assert_array_equal(base_twist(robot, q[3, 4], qdot[3, 4]), twist[3, 4])
    np.testing.assert_array_equal(base_twist(robot, q[::3, 7], qdot[::3, 7]), twist[::3, 7])
    np.testing.assert_array_equal(base_twist(robot, q[:, :1], qdot[:, :1]), twist[:, :1])
    np.testing.assert_array_equal(trajectory_cost(robot, q[5:8], qdot[5:8], 0.1), cost[5:8])
    np.testing.assert_array_equal(trajectory_cost(robot, q[5], qdot[5], 0.1), cost[5])


@quiet
def test_any_layout_of_arrays(way: str) -> None:
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
def test_fall_back_says_once_what_is_missing(
    lacking: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, counting_compiler: Callable[[], int]
) -> None:
    if lacking == "compiler":
        monkeypatch.setenv("CC", "no-such-compiler -O2")
        message = r"no C compiler was found \(CC=no-such-compiler\)"
    elif lacking == "any compiler":
        monkeypatch.delenv("CC")
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
    assert counting_compiler() == 0


def use_every_robot_twice() -> None:
    for name in (*ROBOTS, *ROBOTS):
        robot, _ = robot_and_model(name)
        q, qdot = samples(name, 4)
        np.testing.assert_array_equal(base_twist(robot, q, qdot), robot.base_twist(q, qdot))


def raise_runtime_error() -> Path:
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("import sys; sys.exit('syntax error')", "failed .*: syntax error"),
        ("import time; time.sleep(9)", "did not run"),
    ],
)
def test_compiler_that_fails(
    script: str, message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "compiler.py").write_text(f"import sys\nif '--version' not in sys.argv:\n {script}\n")
    monkeypatch.setenv("CC", f"'{sys.executable}' '{tmp_path / 'compiler.py'}'")
    monkeypatch.setattr(libraries, "TIMEOUT", 0.5)
    with pytest.raises(LibraryError, match=message):
        load_library("int one(void) { return 1; }")
    assert list((tmp_path / "cache").iterdir()) == []


def test_wrong_code_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, _ = robot_and_model("single arm")

    class Zeros:
        @staticmethod
        def map_base_twist(inputs: ctypes.Array, outputs: ctypes.Array, count: int) -> None:
            np.ctypeslib.as_array((ctypes.c_double * (6 * count)).from_address(outputs[0]))[:] = 0.0

    monkeypatch.setattr(functions, "load_library", lambda source: Zeros)
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


def test_library_is_compiled_once(counting_compiler: Callable[[], int]) -> None:
    for _ in range(3):
        load_library("one")
    assert counting_compiler() == 1
    load_library("two")
    assert counting_compiler() == 2
    assert len(list(cache_folder().iterdir())) == 2


@pytest.mark.parametrize("version", ["stand-in 2", "stand-in 1"])
def test_another_compiler_compiles_again(
    version: str, counting_compiler: Callable[[], int], tmp_path: Path
) -> None:
    load_library("one")
    script = tmp_path / "compiler.py"
    script.write_text(script.read_text().replace("stand-in 1", version))
    load_library("one")
    assert counting_compiler() == (1 if version == "stand-in 1" else 2)


@pytest.mark.parametrize("damage", ["empty", "half", "one bit", "text"])
def test_damaged_library_is_built_again(damage: str, counting_compiler: Callable[[], int]) -> None:
    load_library("one")
    (path,) = cache_folder().iterdir()
    intact = path.read_bytes()
    flipped = bytearray(intact)
    flipped[len(intact) // 2] ^= 1
    path.unlink()  # it is mapped into this process, so it must not be written in place
    contents = {"empty": b"", "half": intact[: len(intact) // 2], "one bit": bytes(flipped), "text": b"#!"}
    path.write_bytes(contents[damage])
    load_library("one")
    assert counting_compiler() == 2
    assert path.read_bytes() == intact


def test_library_of_another_system_is_built_again(counting_compiler: Callable[[], int]) -> None:
    load_library("one")
    (path,) = cache_folder().iterdir()
    key, foreign = path.stem.split("-")[0], b"not for this machine"
    path.unlink()
    other = path.with_name(f"{key}-{hashlib.sha256(foreign).hexdigest()[:32]}{path.suffix}")
    other.write_bytes(foreign)
    load_library("one")
    assert counting_compiler() == 2


def planted(key_source: str, tmp_path: Path) -> Path:
    """A library that leaves a mark where it is loaded, named as the cache would name that of a source."""
    load_library(key_source)
    (built,) = cache_folder().iterdir()
    mark = tmp_path / "mark"
    code = f'__attribute__((constructor)) static void go(void) {{ fclose(fopen("{mark}", "w")); }}'
    library = tmp_path / f"planted{built.suffix}"
    compiler = next(filter(shutil.which, ["cc", "gcc", "clang"]))
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-x", "c", "-", "-o", str(library)],
        input="#include <stdio.h>\n" + code,
        text=True,
        check=True,
    )
    digest = hashlib.sha256(library.read_bytes()).hexdigest()[:32]
    place = built.with_name(f"{built.stem.split('-')[0]}-{digest}{built.suffix}")
    built.unlink()
    shutil.copy(library, place)
    place.chmod(0o700)
    return mark


@needs_owners
@pytest.mark.skipif(not HAS_COMPILER, reason="what is planted has to be compiled")
@pytest.mark.parametrize("opened", ["nothing", "folder", "file", "folder above", "link"])
def test_what_others_can_write_is_not_loaded(
    opened: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir(mode=0o700)
    monkeypatch.setattr(tempfile, "tempdir", None)
    above = tmp_path / "above"
    above.mkdir()
    monkeypatch.setenv("SPACE_ENVS_CACHE", str(above / "cache"))
    source = f"int from_{opened.replace(' ', '_')}(void) {{ return 5; }}"
    mark = planted(source, tmp_path)
    cache = cache_folder()
    (library,) = cache.iterdir()
    if opened == "folder":
        cache.chmod(0o770)
    elif opened == "file":
        library.chmod(0o702)
    elif opened == "folder above":
        above.chmod(0o777)
    elif opened == "link":
        library.replace(tmp_path / "elsewhere")
        library.symlink_to(tmp_path / "elsewhere")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = load_library(source)
    assert mark.exists() == (opened == "nothing")
    if opened != "nothing":
        assert getattr(found, f"from_{opened.replace(' ', '_')}")() == 5
    unsafe = [str(one.message) for one in caught if one.category is UnsafeCacheWarning]
    assert len(unsafe) == (opened in ("folder", "folder above"))
    if unsafe:
        said = {"folder": "can be written to by others (mode 770; chmod go-w)", "folder above": "chmod o-w"}
        assert said[opened] in unsafe[0] and "set SPACE_ENVS_CACHE" in unsafe[0]
        (private,) = (tmp_path / "temporary").glob("space_envs-*")
        assert stat.S_IMODE(private.stat().st_mode) == 0o700 and len(list(private.iterdir())) == 1


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


@needs_owners
def test_a_cache_of_somebody_else_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = private_folder(tmp_path / "own")
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(UnsafeCacheError, match=f"belongs to user {os.getuid()}"):
        private_folder(folder)


@needs_owners
def test_folders_and_libraries_of_the_cache_are_private(counting_compiler: Callable[[], int]) -> None:
    mask = os.umask(0)
    try:
        load_library("one")
    finally:
        os.umask(mask)
    (path,) = cache_folder().iterdir()
    assert [stat.S_IMODE(place.stat().st_mode) for place in (path, path.parent)] == [0o700, 0o700]
    assert counting_compiler() == 1


def test_processes_at_once(counting_compiler: Callable[[], int]) -> None:
    command = [
        sys.executable,
        "-c",
        "from space_envs.codegen.libraries import load_library; load_library('one')",
    ]
    running = [
        subprocess.Popen(command, stderr=subprocess.PIPE, cwd=Path(__file__).parents[1]) for _ in range(3)
    ]
    assert [(process.communicate()[1], process.returncode) for process in running] == [(b"", 0)] * 3
    (path,) = cache_folder().iterdir()  # one library, and nothing left of the building
    built = counting_compiler()
    load_library("one")
    assert counting_compiler() == built


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


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {"SPACE_ENVS_CACHE": "/chosen"}, "/chosen"),
        ("linux", {"XDG_CACHE_HOME": "/xdg"}, "/xdg/space_envs"),
        ("linux", {"XDG_CACHE_HOME": "relative"}, "/home/me/.cache/space_envs"),
        ("linux", {}, "/home/me/.cache/space_envs"),
        ("darwin", {"XDG_CACHE_HOME": "/xdg"}, "/home/me/Library/Caches/space_envs"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/space_envs"),
        ("win32", {}, "/home/me/AppData/Local/space_envs"),
    ],
)
def test_place_of_the_cache(
    platform: str, variables: dict[str, str], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("SPACE_ENVS_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(variable, raising=False)
    for variable, value in variables.items():
        monkeypatch.setenv(variable, value)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    assert cache_folder() == Path(expected)
