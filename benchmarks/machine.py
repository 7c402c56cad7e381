"""What a table of measurements must say about where it was made."""

import os
import platform
from importlib.metadata import version
from pathlib import Path


def machine_class() -> str:
    """Processor, cores, Python and the versions that matter, in one line of Markdown."""
    processor = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        processor = names[0] if names else processor
    packages = ", ".join(f"{name} {version(name)}" for name in ("mujoco", "numpy", "gymnasium"))
    return f"{processor}, {os.cpu_count()} cores, Python {platform.python_version()}, {packages}"


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, columns padded so that it reads well in a terminal too."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    lines = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in [header, *rows]]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)
