"""Planning time and time per action of a policy, as measured."""

from typing import TypedDict


class Timing(TypedDict):
    """Milliseconds: to make the plan (None where the policy makes none) and for each action (median).

    Measured one episode at a time, apart from the episodes that are counted, on the processor and with the
    number of threads that are named (None where nothing was timed).
    """

    planning_ms: float | None
    action_ms: float | None
    processor: str | None
    threads: int | None


UNTIMED = Timing(planning_ms=None, action_ms=None, processor=None, threads=None)
