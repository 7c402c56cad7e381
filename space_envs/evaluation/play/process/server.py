"""The process of a policy: builds it, and answers each message of the harness, until there are no more."""

import os
import pickle
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from space_envs.envs import CaptureVectorEnv
from space_envs.errors import PolicyError
from space_envs.evaluation.play.causes import missing_plans, plans_to_json
from space_envs.evaluation.play.process.messages import pack, receive, send, unpack
from space_envs.foreign_code import actions_and_state, described
from space_envs.policy import Policy, PolicyContext
from space_envs.system.processes import end_with


def serve(parent: int) -> None:
    """Answer each message on standard input on standard output, as long as the parent process is there."""
    end_with(parent)
    asking, answering = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # what a policy prints must not stand between answers
    start = receive(asking)
    policy, width = _answer(answering, lambda: _built(start), (None, 0))
    state: Any = None
    while True:
        try:
            values, body = unpack(receive(asking))
        except EOFError:
            return
        if values["build"]:
            policy, width = _answer(answering, lambda: _built(start), (None, 0))
            continue

        def call(values=values, body=body, given=state, policy=policy, width=width) -> tuple[Any, bytes]:
            return _called(policy, width, values, body, given)

        state = _answer(answering, call, None)


def _answer(pipe: int, make: Callable[[], tuple[Any, bytes]], otherwise: Any) -> Any:
    """Result of `make`, whose message is sent; `otherwise` where it raises, after the error was sent."""
    try:
        made, message = make()
    except PolicyError as error:
        made, message = (
            otherwise,
            pack({"error": described(error).partition(": ")[2] or "it says no more"}),
        )
    except BaseException as error:
        made, message = otherwise, pack({"error": f"it raised {described(error)}"})
    try:
        send(pipe, message)
    except OSError:  # the policy closed the pipe, or the harness has gone; nobody reads it
        os._exit(1)
    return made


def _built(start: bytes) -> tuple[tuple[Policy, int], bytes]:
    make, environment = pickle.loads(start)
    context = PolicyContext.from_env(CaptureVectorEnv(**dict(environment, num_envs=1)))
    return (make(context), len(context.action_scale)), pack({})


def _called(
    policy: Policy | None, width: int, values: dict[str, Any], body: bytes, state: Any
) -> tuple[Any, bytes]:
    if policy is None:
        raise PolicyError("it was not built")
    start = None if values["start"] is None else np.array(values["start"], dtype=bool)
    rows = values["rows"]
    observation = np.frombuffer(bytearray(body)).reshape(rows, -1)
    before = time.perf_counter()
    returned = policy.predict(observation, None if values["fresh"] else state, start, values["deterministic"])
    seconds = time.perf_counter() - before
    action, after = actions_and_state(returned, (rows, width))
    failures = plans_to_json(missing_plans(after, rows))
    return after, pack({"seconds": seconds, "failures": failures}, action)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
