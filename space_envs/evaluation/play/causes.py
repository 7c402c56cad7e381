"""Causes of failed episodes, one label each, so that failures can be counted."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.tasks.outcome import ENDED, Outcome

OUTCOMES = tuple(outcome.value for outcome in ENDED)
# Why a policy has no plan; the last is for policies that give no cause, or another one.
NO_PLAN_CAUSES = (
    "infeasible",
    "singular",
    "joint_limit",
    "out_of_reach",
    "clearance",
    "solver",
    "inaccurate",
    "no_plan",
)
# Of a failed episode: why there was no plan, else how it ended.
CAUSES = (*NO_PLAN_CAUSES, *OUTCOMES[1:])
# Outcomes that a missing plan does not explain.
OWN_CAUSES = (Outcome.DIVERGED.value, Outcome.POLICY_ERROR.value)

_OTHER = NO_PLAN_CAUSES[-1]
_LONGEST = 1000  # letters that a reason is cut to


@dataclass(frozen=True)
class MissingPlan:
    """Cause and reason of an episode that a policy has no plan for."""

    cause: str  # one of NO_PLAN_CAUSES
    reason: str


class PlanState:
    """Base of a policy's state that says which of its N episodes have no plan, and why.

    Attributes:
        failures: N entries, None where there is a plan. Any other has a `cause`, one of NO_PLAN_CAUSES, and a
            `reason`, a sentence, or is that sentence alone.
    """

    failures: Sequence[Any] | NDArray[np.object_]


def missing_plans(state: Any, episodes: int) -> list[MissingPlan | None]:
    """Missing plan of each episode, or None, from a policy's state if it is a `PlanState`.

    A state is untrusted: whatever in it is malformed, or raises when it is read, counts as no statement.
    """
    if not issubclass(type(state), PlanState):
        return [None] * episodes
    try:
        failures = list(islice(state.failures, episodes + 1))
    except KeyboardInterrupt:
        raise
    except BaseException:
        return [None] * episodes
    if len(failures) != episodes:
        return [None] * episodes
    return [_missing(each) for each in failures]


def _missing(failure: Any) -> MissingPlan | None:
    """Missing plan from an entry of `failures`: None, a sentence, or an object with `cause` and `reason`."""
    if failure is None:
        return None
    try:
        if isinstance(failure, str):
            return MissingPlan(_OTHER, _plain(failure)) if failure else None
        cause = _plain(failure.cause)
        return MissingPlan(cause if cause in NO_PLAN_CAUSES else _OTHER, _plain(failure.reason))
    except KeyboardInterrupt:
        raise
    except BaseException:
        return MissingPlan(_OTHER, f"the policy gave a {type(failure).__name__} for a reason")


def _plain(text: Any) -> str:
    """A string of Python's own type, since one of a class of its own may do anything."""
    return "".join(str(text))[:_LONGEST]


def plans_to_json(plans: Iterable[MissingPlan | None]) -> list[dict[str, str] | None]:
    """Missing plans as plain JSON values, which `plans_from_json` reads."""
    return [None if plan is None else vars(plan) for plan in plans]


def plans_from_json(values: Iterable[dict[str, str] | None]) -> list[MissingPlan | None]:
    """Missing plans from the values that `plans_to_json` gave."""
    return [None if value is None else MissingPlan(**value) for value in values]


def cause_of(outcome: str, plan: MissingPlan | None) -> str | None:
    """Cause, one of CAUSES: that of a missing plan, else the outcome; None for a capture."""
    if outcome == Outcome.CAPTURED:
        return None
    return outcome if plan is None or outcome in OWN_CAUSES else plan.cause


def causes_of(outcome: str) -> tuple[str, ...]:
    """Causes that an episode with this outcome may have."""
    return (outcome,) if outcome in OWN_CAUSES else (outcome, *NO_PLAN_CAUSES)


def check_cause(captured: bool, outcome: str, cause: str | None) -> None:
    """ConfigurationError unless there is such an outcome, and `captured` and the cause fit it."""
    if outcome not in OUTCOMES:
        raise unknown_name("outcome", outcome, OUTCOMES)
    if captured != (outcome == Outcome.CAPTURED):
        raise ConfigurationError(f"captured is {captured} but outcome is {outcome!r}")
    if captured:
        if cause is not None:
            raise ConfigurationError(f"cause is {cause!r} but the episode captured; a capture has none")
    elif cause not in causes_of(outcome):
        raise unknown_name(f"cause of outcome {outcome!r}:", cause, causes_of(outcome))
