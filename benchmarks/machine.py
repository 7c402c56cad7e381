"""What the tables of measurements have in common."""

from space_envs.evaluation.provenance import machine, versions


def machine_class() -> str:
    """Processor, cores, Python and the versions that matter, in one line."""
    used = versions()
    return f"{machine()}, " + ", ".join(
        f"{name} {used[name]}" for name in ("python", "mujoco", "numpy", "gymnasium")
    )


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, columns padded so that it reads well in a terminal too."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |"
        for row in [header, *rows]
    ]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)
