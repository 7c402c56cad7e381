"""One session of a training run, and the time that the run has used over all of them."""

import time
from dataclasses import dataclass, field

from agents.learning.runs.folder import RunFolder
from agents.learning.runs.hyperparameters import AnyHyperparameters
from agents.learning.runs.settings import Settings


@dataclass
class Budget:
    """Wall and processor time of a run.

    Attributes:
        limit: s of wall time, None without limit. used, used_cpu: s in earlier sessions.
    """

    limit: float | None = None
    used: float = 0.0
    used_cpu: float = 0.0
    _start: float = field(default_factory=time.perf_counter)
    _start_cpu: float = field(default_factory=time.process_time)

    @property
    def wall(self) -> float:
        """Wall time, s."""
        return self.used + time.perf_counter() - self._start

    @property
    def cpu(self) -> float:
        """Processor time of all threads, s."""
        return self.used_cpu + time.process_time() - self._start_cpu

    @property
    def exhausted(self) -> bool:
        """Whether the limit is reached."""
        return self.limit is not None and self.wall >= self.limit

    def add(self, wall: float, cpu: float) -> None:
        """Count time, s, that was used elsewhere."""
        self.used += wall
        self.used_cpu += cpu

    def fraction(self, since: float) -> float:
        """Used share of the wall time that remained at `since` s."""
        if self.limit is None:
            return 0.0
        return min((self.wall - since) / max(self.limit - since, 1e-9), 1.0)


@dataclass(frozen=True)
class Session:
    """A run from its start, or its last checkpoint, to its end or its interruption.

    Attributes:
        folder, settings, parameters, budget: of the run.
        episodes: of a validation; None takes the usual number.
        quiet: neither progress bar nor lines.
    """

    folder: RunFolder
    settings: Settings
    parameters: AnyHyperparameters
    budget: Budget = field(default_factory=Budget)
    episodes: int | None = None
    quiet: bool = False
