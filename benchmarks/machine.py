"""Description of the machine, verdicts and Markdown tables, shared by all benchmarks."""

from space_envs.system.provenance import machine, versions


def machine_class() -> str:
    """Processor, cores, and versions of Python and the numerical packages, in one line."""
    used = versions()
    return f"{machine()}, " + ", ".join(
        f"{name} {used[name]}" for name in ("python", "mujoco", "numpy", "gymnasium")
    )


def verdict(value: float, most: float) -> str:
    """Whether a figure is within its upper bound: "met", or by how much it is missed."""
    return "met" if value <= most else f"missed by {100.0 * (value / most - 1.0):.0f} %"


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table with padded columns, readable in a terminal too."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in [header, *rows]
    ]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)
