"""Where figures come from: command, versions, commit and machine."""

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from space_envs.tasks.base import CaptureTask

PACKAGES = ("space-capture", "mujoco", "numpy", "scipy", "gymnasium", "casadi", "torch", "stable-baselines3")


def provenance(command: str, env_id: str, seed: int, task: CaptureTask) -> dict[str, Any]:
    """All that a reader needs to repeat a run, as plain JSON values."""
    return {
        "command": command,
        "environment": env_id,
        "seed": seed,
        "eq. 20 c, m/rad": task.c,
        "simulation step, s": task.step_size,
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }


def versions() -> dict[str, str]:
    """Version of Python and of each package that decides a result; 'not installed' where it is not."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> str:
    """Processor, number of cores and system, in one line."""
    processor = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                processor = line.split(":", 1)[1].strip()
                break
    return f"{processor}, {os.cpu_count()} cores, {platform.system()}"


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
