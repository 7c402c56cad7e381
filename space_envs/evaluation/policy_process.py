"""A policy in a process of its own, so that a call that takes too long can be ended.

The process gets arrays and gives arrays; it has no way to the simulation. What builds the policy goes to the
process as a pickle, made for it alone; its answers are JSON and plain arrays, so nothing that a policy says
is unpickled.
"""

import io
import json
import math
import os
import pickle
import select
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.causes import MissingPlan, missing_plans, packed_plans, unpacked_plans
from space_envs.evaluation.policy import Policy, PolicyContext

STARTING = 120.0  # s, that a policy may take to be imported and built, where its calls have limits
_LENGTH = struct.Struct("<Q")


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
        self._start = cloudpickle.dumps((list(sys.path), cloudpickle.dumps((build, environment))))
        self._limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self.seconds = 0.0

    def __enter__(self) -> "PolicyProcess":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop()

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """The other policy's actions (N, m); the state is a token, with `failures` where it has any.

        Raises:
            TimeLimitError: if the call takes too long. PolicyError: if the policy raises or its process dies.
        """
        begins = state is None or (episode_start is not None and bool(np.any(episode_start)))
        if self._process is None:
            self._started()
        limits = self._limits
        limit = math.inf if limits is None else limits.planning if begins else limits.action
        told = {
            "fresh": state is None,
            "start": None if episode_start is None else np.asarray(episode_start, dtype=bool).tolist(),
            "deterministic": deterministic,
        }
        late = f"no {'first action' if begins else 'action'} within {limit:g} s"
        answer, action = self._asked(_packed(told, observation), limit, late)
        self.seconds = answer["seconds"]
        return action, _Token(unpacked_plans(answer["failures"]))

    def _started(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "space_envs.evaluation.policy_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
        )
        limit = math.inf if self._limits is None else STARTING
        self._asked(self._start, limit, f"it was not built within {STARTING:g} s")

    def _asked(self, message: bytes, limit: float, late: str) -> tuple[dict[str, Any], Any]:
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise PolicyError("the policy's process is not there")
        try:
            _write(process.stdin, message)
            ready, _, _ = select.select([process.stdout], [], [], limit if math.isfinite(limit) else None)
            if not ready:
                self._stop()
                raise TimeLimitError(late)
            answer, array = _unpacked(_read(process.stdout))
        except (OSError, EOFError):
            self._stop()
            raise PolicyError(f"its process ended, with exit status {process.returncode}") from None
        if "error" in answer:
            raise PolicyError(answer["error"])
        return answer, array

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    try:
                        pipe.close()
                    except OSError:
                        pass  # what was not flushed has no reader
            self._process = None


@dataclass(frozen=True)
class _Token:
    """What the harness holds in place of a state."""

    failures: list[MissingPlan | None]


def _packed(told: dict[str, Any], array: NDArray[Any] | None = None) -> bytes:
    """Plain values and an array; ValueError for an array of objects."""
    head, body = json.dumps(told).encode(), io.BytesIO()
    if array is not None:
        np.save(body, array, allow_pickle=False)
    return _LENGTH.pack(len(head)) + head + body.getvalue()


def _unpacked(message: bytes) -> tuple[dict[str, Any], Any]:
    """What `_packed` was given."""
    (size,) = _LENGTH.unpack(message[: _LENGTH.size])
    head, body = message[_LENGTH.size :][:size], message[_LENGTH.size + size :]
    return json.loads(head), np.load(io.BytesIO(body), allow_pickle=False) if body else None


def _write(pipe: BinaryIO | Any, message: bytes) -> None:
    pipe.write(_LENGTH.pack(len(message)) + message)
    pipe.flush()


def _read(pipe: BinaryIO | Any) -> bytes:
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (size,) = _LENGTH.unpack(head)
    body = pipe.read(size)
    if len(body) < size:
        raise EOFError
    return body


def _serve() -> None:
    """The other process: one answer for each message, until there are no more."""
    asking, answering = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a policy prints must not stand between answers

    def answer(make: Callable[[], tuple[Any, bytes]]) -> Any:
        try:
            made, message = make()
        except PolicyError as error:
            made, message = None, _packed({"error": str(error)})
        except (Exception, SystemExit) as error:
            made, message = None, _packed({"error": f"it raised {type(error).__name__}: {error}"})
        _write(answering, message)
        return made

    def build() -> tuple[Policy, bytes]:
        from space_envs.envs import CaptureVectorEnv

        sys.path[:], packed = pickle.loads(_read(asking))
        make, environment = pickle.loads(packed)  # once modules are found where the harness finds them
        return make(PolicyContext.from_env(CaptureVectorEnv(**{**environment, "num_envs": 1}))), _packed({})

    policy = answer(build)
    state: Any = None
    while policy is not None:
        try:
            told, observation = _unpacked(_read(asking))
        except EOFError:
            return

        def call(told=told, observation=observation, given=state) -> tuple[Any, bytes]:
            start = None if told["start"] is None else np.array(told["start"], dtype=bool)
            before = time.perf_counter()
            action, after = policy.predict(
                observation, None if told["fresh"] else given, start, told["deterministic"]
            )
            seconds = time.perf_counter() - before
            failures = packed_plans(missing_plans(after, len(observation)))
            return after, _packed({"seconds": seconds, "failures": failures}, np.asarray(action))

        state = answer(call)


if __name__ == "__main__":
    _serve()
