"""A paper's claims put to the test: on the paper's own case, and over random ones.

One rule is applied to every record alike. It answers yes, no, or None where a case lacks what the claim is
about (a method that found no plan); such cases are not in the denominator, and their number is shown.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reproduce.page.text import PageText
from space_envs.evaluation.statistics.intervals import wilson_interval
from space_envs.evaluation.statistics.resampling import CONFIDENCE

CaseRecord = Mapping[str, Any]
ClaimTest = Callable[[CaseRecord], bool | None]


@dataclass(frozen=True)
class Rule:
    """A claim before it is tested.

    Attributes:
        key: short name. where: section and figure of the paper.
        says: the claim, near to the paper's words. counted: the condition under which it counts as true.
        measured: the figures of a record that decide, as a sentence.
        test: whether the claim holds in a record; None where it cannot be asked. A rule without a test is
            reported and not counted.
        remark: a note on how to read the result.
    """

    key: str
    where: str
    says: str
    counted: str
    measured: Callable[[CaseRecord], str]
    test: ClaimTest | None = None
    remark: str = ""


@dataclass(frozen=True)
class Share:
    """Number of cases in which something holds, out of those asked; `left_out` could not be asked."""

    holds: int
    of: int
    left_out: int = 0

    @property
    def rate(self) -> float:
        """Share of the cases asked in which it holds, 0 to 1; NaN where none was asked."""
        return self.holds / self.of if self.of else float("nan")

    @property
    def interval(self) -> str:
        """The ends of the Wilson interval, in percent."""
        if not self.of:
            return ""
        found = wilson_interval(self.holds, self.of)
        return f"{100 * found.low:.0f} to {100 * found.high:.0f} %"

    def __str__(self) -> str:
        if not self.of:
            return "no case"
        return f"{self.holds} of {self.of} ({100 * self.rate:.0f} %, {self.interval})"


@dataclass(frozen=True)
class Claim:
    """A rule with its results: on the paper's case, and over random cases where it is counted."""

    rule: Rule
    measured: str
    holds: bool | None
    share: Share | None

    @property
    def verdict(self) -> str:
        """Result on the paper's case, in a word."""
        return {True: "holds", False: "does not hold", None: "not decided"}[self.holds]


WORDS = ("where", "says", "counted", "remark")  # fields of a claim that do not depend on a record
SHARE_NOTE = f"Ranges of shares are {100 * CONFIDENCE:.0f} % Wilson intervals."


def rules(
    text: PageText,
    entry: str,
    tests: Sequence[ClaimTest],
    figures: Callable[[CaseRecord], Mapping[str, Any]],
) -> tuple[Rule, ...]:
    """Rules of the claims that an entry of a page's text lists, in its order.

    Args:
        tests: functions named as the claims that they decide; a claim without one is not counted.
        figures: values of a record that the sentences `measured` show.

    Raises:
        ValueError: for a test without a claim.
    """
    by_key = {getattr(test, "__name__", ""): test for test in tests}
    listed: list[dict[str, str]] = text.raw(entry)
    if lost := by_key.keys() - {claim["key"] for claim in listed}:
        raise ValueError(f"tests without a claim in {entry!r}: {', '.join(sorted(lost))}")

    def rule(claim: dict[str, str]) -> Rule:
        template = claim["measured"]
        words = {name: text.filled(claim.get(name, ""), {}) for name in WORDS}
        return Rule(
            key=claim["key"],
            measured=lambda record: text.filled(template, figures(record)),
            test=by_key.get(claim["key"]),
            **words,
        )

    return tuple(rule(claim) for claim in listed)


def count(test: ClaimTest, records: Iterable[CaseRecord]) -> Share:
    """Share of the records in which `test` holds, among those in which it can be asked."""
    answers = [test(record) for record in records]
    asked = [answer for answer in answers if answer is not None]
    return Share(sum(asked), len(asked), len(answers) - len(asked))


def settle(rules: Sequence[Rule], own: CaseRecord, cases: Sequence[CaseRecord]) -> list[Claim]:
    """Apply every rule to the paper's own case and to the random ones."""
    return [
        Claim(
            rule,
            rule.measured(own),
            None if rule.test is None else rule.test(own),
            None if rule.test is None else count(rule.test, cases),
        )
        for rule in rules
    ]
