"""A policy in a process of its own, so that it can be ended and has no way to the simulation.

The process gets arrays and gives arrays. What builds the policy goes to it as a pickle made for it alone. Its
answers are JSON and plain numbers, and untrusted: none of them is unpickled. It ends with the process that
started it.
"""

import math
import os
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
from space_envs.errors import PolicyError
from space_envs.evaluation.play.causes import MissingPlan, PlanState, plans_from_json
from space_envs.evaluation.play.process.limits import TimeLimitError, TimeLimits
from space_envs.evaluation.play.process.messages import pack, receive, send, unpack
from space_envs.foreign_code import plain_text
from space_envs.policy import Policy, PolicyContext

STARTING = 120.0  # s, that a policy may take to be imported and built, where its calls have limits
_LARGEST = 2**20  # bytes of an answer besides its actions


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
        self._renewed = False
        self.seconds = 0.0

    def __enter__(self) -> "PolicyProcess":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop()

    def renew(self) -> None:
        """Build the policy again for the next call, so that it remembers nothing."""
        self._renewed = True

    def build(self) -> None:
        """Build the policy now.

        Raises:
            PolicyError: if it cannot be built, or its process dies.
        """
        limit = math.inf if self._limits is None else STARTING
        late = f"it was not built within {STARTING:g} s"
        if self._process is not None:
            self._asked(pack({"build": True}), limit, late, 0)
        else:
            self._process = subprocess.Popen(
                # -P: modules are found where this process finds them, and not in the working directory first.
                [sys.executable, "-P", "-m", "space_envs.evaluation.play.process.server", str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
                start_new_session=True,  # Ctrl-C is for the harness, and what it starts ends with it
            )
            self._asked(self._start, limit, late, 0)
        self._renewed = False

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
        if self._process is None or self._renewed:
            self.build()
        limits = self._limits
        limit = math.inf if limits is None else limits.planning if begins else limits.action
        values = {
            "build": False,
            "rows": len(observation),
            "fresh": state is None,
            "start": None if episode_start is None else np.asarray(episode_start, dtype=bool).tolist(),
            "deterministic": deterministic,
        }
        late = f"no {'first action' if begins else 'action'} within {limit:g} s"
        before = time.perf_counter()
        answer, body = self._asked(pack(values, observation), limit, late, 64 * observation.nbytes)
        passed = time.perf_counter() - before
        try:
            action = np.frombuffer(body).reshape(len(observation), -1)
            plans = plans_from_json(answer["failures"])
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
            send(process.stdin.fileno(), message, deadline)
            answer, body = unpack(receive(process.stdout.fileno(), deadline, _LARGEST + largest))
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
    """State that the harness holds in place of the policy's own."""

    failures: list[MissingPlan | None]
