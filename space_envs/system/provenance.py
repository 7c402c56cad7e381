"""Provenance of results: command, versions, commit and machine."""

import os
import platform
import subprocess
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PROJECT = "space-capture"
PACKAGES = (PROJECT, "mujoco", "numpy", "scipy", "gymnasium", "casadi", "torch", "stable-baselines3")


def provenance(command: str, seeds: Sequence[int]) -> dict[str, Any]:
    """Information needed to repeat a run, as plain JSON values."""
    return {
        "command": command,
        "seeds": list(seeds),
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }


def package_version(name: str = PROJECT) -> str:
    """Version of an installed package, by default of this project; 'not installed' where it is not."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def versions() -> dict[str, str]:
    """Versions of Python and of each package that decides a result, by name."""
    return {"python": platform.python_version()} | {name: package_version(name) for name in PACKAGES}


def processor() -> str:
    """Name of the processor."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def machine() -> str:
    """Processor, number of cores and system, in one line."""
    return f"{processor()}, {os.cpu_count()} cores, {platform.system()}"


def commit() -> str:
    """Commit of the checkout that the package runs from, with a + if it has changes; 'none' outside one."""
    folder = Path(__file__).resolve().parent
    try:
        run = [
            subprocess.run(
                ["git", *words], cwd=folder, capture_output=True, text=True, timeout=10, check=True
            ).stdout
            for words in (
                ["rev-parse", "--short=12", "HEAD"],
                ["status", "--porcelain", "--untracked-files=no"],
            )
        ]
    except (OSError, subprocess.SubprocessError):
        return "none"
    return run[0].strip() + ("+" if run[1].strip() else "")
