"""The leaderboard in LaTeX."""

from collections.abc import Sequence

from space_envs.evaluation.leaderboard.columns import KNOWLEDGE, RANK, RULES, Column, columns_of, leaders
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import latex_name
from space_envs.evaluation.report.tables.wording import by_task, counts_summary, modes_summary, row_name


def to_latex(rows: Sequence[Row]) -> str:
    """One table (booktabs) for each task to \\input into a paper, the best figures of each column bold."""
    parts = ["% \\usepackage{booktabs} in the preamble.\n"]
    for task, group in by_task(rows):
        columns = [c for c in columns_of(group[0].metrics) if c.display.room == "paper"]
        caption = f"{latex_name(str(task))}: {counts_summary(group)}, 95\\,\\% intervals in brackets. "
        caption += f"Control mode: {latex_name(modes_summary(group))}."
        heads = [latex_name(column.title) for column in columns]
        units = [f"[{_latex_unit(column.unit)}]" if column.unit else "" for column in columns]
        parts += [
            "\\begin{table}\n  \\centering\\small\n",
            f"  \\caption{{{caption}}}\n",
            f"  \\begin{{tabular}}{{rll{'r' * len(columns)}}}\n    \\toprule\n",
            f"    {RANK.title} & policy & {KNOWLEDGE} & {' & '.join(heads)} \\\\\n",
            f"    & & & {' & '.join(units)} \\\\\n    \\midrule\n",
        ]
        for row in group:
            cells = [_latex_cell(column, row, group) for column in columns]
            cells = [RANK.value(row), latex_name(row_name(row, group)), latex_name(row.knowledge), *cells]
            parts.append(f"    {' & '.join(cells)} \\\\\n")
        parts.append("    \\bottomrule\n  \\end{tabular}\n")
        parts.append(f"  \\par\\smallskip\\footnotesize {' '.join(RULES)}\n\\end{{table}}\n")
    return "".join(parts)


def _latex_unit(unit: str) -> str:
    return latex_name(unit).replace(r"\textasciicircum{}2", r"\textsuperscript{2}")


def _latex_cell(column: Column, row: Row, rows: Sequence[Row]) -> str:
    value = column.value(row)
    shown = f"\\textbf{{{value}}}" if row in leaders(column, rows) else value
    interval = column.interval(row).replace("[", "{[}").replace("]", "{]}")
    return f"{shown} {{\\footnotesize {interval}}}" if interval else shown
