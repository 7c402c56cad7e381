"""Built-in policies that raised or gave no actions: faults of the project, and no policy's score."""

from collections import Counter
from collections.abc import Iterable

from agents.policies.registry import POLICIES
from space_envs.evaluation.records.episode import EpisodeRecord

# What ends an episode without a fault: a user's time limit, and a planner that says it found no plan.
EXPECTED = ("no action within ", "no first action within ", "it raised PlanningError: ")


def defects(records: Iterable[EpisodeRecord], names: Iterable[str] = tuple(POLICIES)) -> list[str]:
    """A line for each built-in policy on each id that failed in another way than planners may.

    Args:
        names: of the policies that are built in.
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
