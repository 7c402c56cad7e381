"""Tables of a study as CSV: the figures of every case, and the claims."""

import csv
import io
from collections.abc import Iterable, Sequence

from reproduce.claims import CaseRecord, Claim
from space_envs.evaluation.records.names import csv_name


def cases_csv(case: str, records: Iterable[CaseRecord]) -> str:
    """Every figure of every method in every record, as CSV; the first column is called `case`."""
    records = list(records)
    methods = [(record, key, found) for record in records for key, found in record["methods"].items()]
    names = list(
        dict.fromkeys(name for *_, found in methods for name in found if name not in ("cause", "reason"))
    )
    rows = [
        (record["index"], key, found.get("cause"), *map(found.get, names), record["timing"][key])
        for record, key, found in methods
    ]
    return table_csv((case, "method", "cause", *names, "planning_s"), rows)


def claims_csv(case: str, claims: Iterable[Claim]) -> str:
    """Verdict and share of every claim, as CSV; `case` heads the verdicts on the paper's own case."""
    rows = [
        (
            claim.rule.key,
            claim.rule.where,
            claim.rule.says,
            claim.verdict,
            *(vars(claim.share).values() if claim.share else [None] * 3),
        )
        for claim in claims
    ]
    return table_csv(("claim", "where", "says", case, "holds", "of", "left_out"), rows)


def table_csv(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as CSV; numbers with all digits, text harmless to spreadsheets, nothing for None."""

    def cell(value: object) -> object:
        if value is None:
            return ""
        if isinstance(value, float):
            return repr(value)
        return value if isinstance(value, int) else csv_name(str(value))

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow([cell(value) for value in row])
    return text.getvalue()
