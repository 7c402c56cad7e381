"""Built-in policies that raised or returned no actions: defects of the project, not results of a policy."""

from collections import Counter
from collections.abc import Iterable

from agents.policies.registry import POLICIES
from space_envs.evaluation.records.episode import EpisodeRecord

# Reasons that are no defect: a user's time limit, and a planner that reports that it found no plan.
EXPECTED = ("no action within ", "no first action within ", "it raised PlanningError: ")


def defects(records: Iterable[EpisodeRecord], names: Iterable[str] = tuple(POLICIES)) -> list[str]:
    """One line for each built-in policy on each id with failures that are defects.

    Args:
        names: of the built-in policies.
    """
    built_in = set(names)
    reasons: dict[tuple[str, str], Counter[str]] = {}
    for record in records:
        reason = record.reason or "no reason was recorded"
        if record.outcome == "policy_error" and record.policy in built_in and not reason.startswith(EXPECTED):
            reasons.setdefault((record.policy, record.env_id), Counter())[reason] += 1
    return [
        f"built-in policy {policy!r} failed on {env_id}, in {sum(counted.values())} episodes: "
        f"{counted.most_common(1)[0][0]}"
        for (policy, env_id), counted in reasons.items()
    ]
