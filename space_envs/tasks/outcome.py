"""Outcomes of an episode: the one list, with the texts that pages and plots show; and the score of one."""

from enum import StrEnum
from typing import Self

import numpy as np


class Outcome(StrEnum):
    """State of an episode after a control period; a member is the text in `info["outcome"]` and in records.

    Attributes:
        code: place in the order below, which arrays hold.
        flag: flag of `step` that is raised, `terminated`, `truncated` or none.
        meaning: when an episode has this outcome, in a sentence.
        label, plural: of one episode and of several, in tables and plots.
    """

    code: int
    flag: str
    meaning: str
    label: str
    plural: str

    def __new__(cls, value: str, flag: str, meaning: str, plural: str = "") -> Self:
        member = str.__new__(cls, value)
        member._value_ = value
        member.code, member.flag, member.meaning = len(cls.__members__), flag, meaning
        member.label = value.replace("_", " ")
        member.plural = plural or member.label
        return member

    RUNNING = "running", "", "The episode goes on."
    CAPTURED = "captured", "terminated", "The capture conditions have held for the hold time."
    TIMEOUT = "timeout", "truncated", "The horizon was reached.", "timeouts"
    ATTITUDE_LOST = (
        "attitude_lost",
        "terminated",
        "The satellite has rotated by more than `attitude_limit` from its attitude at the start.",
    )
    DIVERGED = (
        "diverged",
        "terminated",
        "The simulation left the finite numbers; the observation is the last finite one.",
    )
    COLLISION = (
        "collision",
        "terminated",
        "A link touched a body that it must not touch; `info` says which link and what.",
        "collisions",
    )
    POLICY_ERROR = (
        "policy_error",
        "",
        "The policy raised an exception or returned something that is not an action; only in records.",
        "policy errors",
    )


ENV_OUTCOMES = tuple(outcome for outcome in Outcome if outcome is not Outcome.POLICY_ERROR)
ENDED = tuple(outcome for outcome in Outcome if outcome is not Outcome.RUNNING)  # outcomes of a record


def kept_attitude(captured: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Score (n,) of each episode: captured / (1 + peak attitude / 1 deg).

    Captured (n,) bool, peak (n,) deg, +infinity where it does not exist. A failure scores 0, a capture that
    never rotated the base 1, one that rotated it by at most 1 deg 1/2.
    """
    return np.asarray(captured, dtype=bool) / (1.0 + np.asarray(peak, dtype=np.float64))
