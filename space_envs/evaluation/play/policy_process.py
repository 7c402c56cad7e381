"""A policy in a process of its own, so that it can be ended and has no way to the simulation.

The process gets arrays and gives arrays. What builds the policy goes to it as a pickle made for it alone. Its
answers are JSON and plain numbers, checked as those of a stranger: nothing that it says is unpickled. It ends
with the process that started it.
"""

import json
import math
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.play.causes import (
    MissingPlan,
    PlanState,
    missing_plans,
    packed_plans,
    unpacked_plans,
)
from space_envs.policy import Policy, PolicyContext
from space_envs.strangers import actions_and_state, described, plain_text
from space_envs.system.processes import end_with
from space_envs.system.reading import parse_json

STARTING = 120.0  # s, that a policy may take to be imported and built, where its calls have limits
_LENGTH = struct.Struct("<Q")
_LARGEST = 2**20  # bytes of an answer besides its actions


@dataclass(frozen=True)
class TimeLimits:
    """Seconds that a call of a policy may take: the first one of an episode, which plans, and any other."""

    planning: float
    action: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0.0:
                raise ConfigurationError(f"the time limit of {name} must be positive, got {value}")


class TimeLimitError(PolicyError):
    """A policy took longer than it may."""


class PolicyProcess:
    """Policy that calls another one in a process of its own; use as a context manager.

    The policy's state stays in that process. After a call that took too long, and after the process died, a
    new process is started for the next episode.

    Args:
        build: makes the policy from a context. environment: keywords of the `CaptureVectorEnv` that the
            context is of. limits: of its calls; None for as long as they take.

    Attributes:
        seconds: that the last call took, without what passes between the processes.
    """

    def __init__(
        self,
        build: Callable[[PolicyContext], Policy],
        environment: dict[str, Any],
        limits: TimeLimits | None = None,
    ) -> None:
        self._start = cloudpickle.dumps((build, environment))
        self._limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._anew = False
        self.seconds = 0.0

    def __enter__(self) -> "PolicyProcess":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop()

    def renew(self) -> None:
        """Build the policy anew for the next call, so that it remembers nothing."""
        self._anew = True

    def build(self) -> None:
        """Build the policy now.

        Raises:
            PolicyError: if it cannot be built, or its process dies.
        """
        limit = math.inf if self._limits is None else STARTING
        late = f"it was not built within {STARTING:g} s"
        if self._process is not None:
            self._asked(_packed({"build": True}), limit, late, 0)
        else:
            self._process = subprocess.Popen(
                # -P: modules are found where this process finds them, and not in the working directory first.
                [sys.executable, "-P", "-m", "space_envs.evaluation.play.policy_process", str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
                start_new_session=True,  # Ctrl-C is for the harness, and what it starts ends with it
            )
            self._asked(self._start, limit, late, 0)
        self._anew = False

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """The other policy's actions (N, m); the state is a token that says which episodes have no plan.

        Raises:
            TimeLimitError: if the call takes too long. PolicyError: if the policy raises, returns no actions
                or its process dies.
        """
        begins = state is None or (episode_start is not None and bool(np.any(episode_start)))
        if self._process is None or self._anew:
            self.build()
        limits = self._limits
        limit = math.inf if limits is None else limits.planning if begins else limits.action
        told = {
            "build": False,
            "rows": len(observation),
            "fresh": state is None,
            "start": None if episode_start is None else np.asarray(episode_start, dtype=bool).tolist(),
            "deterministic": deterministic,
        }
        late = f"no {'first action' if begins else 'action'} within {limit:g} s"
        before = time.perf_counter()
        answer, body = self._asked(_packed(told, observation), limit, late, 64 * observation.nbytes)
        passed = time.perf_counter() - before
        try:
            action = np.frombuffer(body).reshape(len(observation), -1)
            plans = unpacked_plans(answer["failures"])
            seconds = float(answer["seconds"])
        except (ValueError, KeyError, TypeError):
            self._stop()
            raise PolicyError(_NONSENSE) from None
        self.seconds = seconds if 0.0 <= seconds <= passed else passed
        return action, _Token(plans)

    def _asked(self, message: bytes, limit: float, late: str, largest: int) -> tuple[dict[str, Any], bytes]:
        """An answer and the numbers that come with it, at most `largest` bytes of them."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise PolicyError("the policy's process is not there")
        deadline = time.monotonic() + limit
        try:
            _send(process.stdin.fileno(), message, deadline)
            answer, body = _unpacked(_receive(process.stdout.fileno(), deadline, _LARGEST + largest))
        except TimeoutError:
            self._stop()
            raise TimeLimitError(late) from None
        except (OSError, EOFError):
            self._stop()
            raise PolicyError(f"its process ended, with exit status {process.returncode}") from None
        except (ValueError, struct.error):
            self._stop()
            raise PolicyError(_NONSENSE) from None
        if "error" in answer:
            raise PolicyError(plain_text(str(answer["error"])))
        return answer, body

    def _stop(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


_NONSENSE = "its process answered in a way that no policy can by itself"


@dataclass(frozen=True)
class _Token(PlanState):
    """What the harness holds in place of a state."""

    failures: list[MissingPlan | None]


def _packed(told: dict[str, Any], array: Array | None = None) -> bytes:
    """Plain values, and numbers as they stand in memory."""
    head = json.dumps(told).encode()
    return _LENGTH.pack(len(head)) + head + (b"" if array is None else np.ascontiguousarray(array).tobytes())


def _unpacked(message: bytes) -> tuple[dict[str, Any], bytes]:
    """What `_packed` was given, the numbers as bytes; ValueError or struct.error for anything else."""
    (size,) = _LENGTH.unpack(message[: _LENGTH.size])
    told = parse_json(message[_LENGTH.size :][:size])
    if not isinstance(told, dict):
        raise ValueError("expected an object")
    return told, message[_LENGTH.size + size :]


def _send(pipe: int, message: bytes, deadline: float = math.inf) -> None:
    os.set_blocking(pipe, False)
    left = memoryview(_LENGTH.pack(len(message)) + message)
    while left:
        _wait(deadline, writing=pipe)
        left = left[os.write(pipe, left) :]


def _receive(pipe: int, deadline: float = math.inf, largest: int | None = None) -> bytes:
    (size,) = _LENGTH.unpack(_exactly(pipe, _LENGTH.size, deadline))
    if largest is not None and size > largest:
        raise ValueError(f"expected at most {largest} bytes, got {size}")
    return _exactly(pipe, size, deadline)


def _exactly(pipe: int, size: int, deadline: float) -> bytes:
    found = bytearray()
    while len(found) < size:
        _wait(deadline, reading=pipe)
        part = os.read(pipe, min(size - len(found), 2**20))
        if not part:
            raise EOFError
        found += part
    return bytes(found)


def _wait(deadline: float, reading: int | None = None, writing: int | None = None) -> None:
    left = None if math.isinf(deadline) else max(deadline - time.monotonic(), 0.0)
    to_read, to_write = ([] if pipe is None else [pipe] for pipe in (reading, writing))
    if not any(select.select(to_read, to_write, [], left)):
        raise TimeoutError


def _serve(parent: int) -> None:
    """The other process: one answer for each message, until there are no more."""
    end_with(parent)
    asking, answering = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # what a policy prints must not stand between answers
    start = _receive(asking)
    policy, width = _answer(answering, lambda: _built(start), (None, 0))
    state: Any = None
    while True:
        try:
            told, body = _unpacked(_receive(asking))
        except EOFError:
            return
        if told["build"]:
            policy, width = _answer(answering, lambda: _built(start), (None, 0))
            continue

        def call(told=told, body=body, given=state, policy=policy, width=width) -> tuple[Any, bytes]:
            return _called(policy, width, told, body, given)

        state = _answer(answering, call, None)


def _answer(pipe: int, make: Callable[[], tuple[Any, bytes]], otherwise: Any) -> Any:
    """What is made, after its message was sent; `otherwise` where it cannot be made, after why was sent."""
    try:
        made, message = make()
    except PolicyError as error:
        made, message = (
            otherwise,
            _packed({"error": described(error).partition(": ")[2] or "it says no more"}),
        )
    except BaseException as error:
        made, message = otherwise, _packed({"error": f"it raised {described(error)}"})
    try:
        _send(pipe, message)
    except OSError:  # the policy closed the pipe, or the harness has gone; nobody is left to be told
        os._exit(1)
    return made


def _built(start: bytes) -> tuple[tuple[Policy, int], bytes]:
    from space_envs.envs import CaptureVectorEnv

    make, environment = pickle.loads(start)
    context = PolicyContext.from_env(CaptureVectorEnv(**dict(environment, num_envs=1)))
    return (make(context), len(context.action_scale)), _packed({})


def _called(
    policy: Policy | None, width: int, told: dict[str, Any], body: bytes, state: Any
) -> tuple[Any, bytes]:
    if policy is None:
        raise PolicyError("it was not built")
    start = None if told["start"] is None else np.array(told["start"], dtype=bool)
    rows = told["rows"]
    observation = np.frombuffer(bytearray(body)).reshape(rows, -1)
    before = time.perf_counter()
    returned = policy.predict(observation, None if told["fresh"] else state, start, told["deterministic"])
    seconds = time.perf_counter() - before
    action, after = actions_and_state(returned, (rows, width))
    failures = packed_plans(missing_plans(after, rows))
    return after, _packed({"seconds": seconds, "failures": failures}, action)


if __name__ == "__main__":
    _serve(int(sys.argv[1]))
