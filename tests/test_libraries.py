"""The cache of compiled libraries: built once, rebuilt when damaged, private to its user."""

import hashlib
import os
import shutil
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from space_envs.codegen import libraries
from space_envs.codegen.cache import (
    LibraryError,
    UnsafeCacheError,
    UnsafeCacheWarning,
    cache_folder,
    private_folder,
)
from space_envs.codegen.libraries import load_library

HAS_COMPILER = any(map(shutil.which, [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]))
needs_owners = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")


@pytest.fixture(autouse=True)
def empty_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SPACE_ENVS_CACHE", str(tmp_path / "cache"))


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
def test_files_that_others_can_write_are_not_loaded(
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
