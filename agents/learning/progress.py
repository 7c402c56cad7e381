"""Progress of a run: at every interval a validation, the best policy, a checkpoint and a line."""

import sys
from dataclasses import fields, replace
from typing import Any

from stable_baselines3.common.logger import Logger, configure
from tqdm import tqdm

from agents.learning.runs.session import Session
from agents.learning.runs.warm_start import knowledge_of
from agents.learning.validation import Validation, Validator
from agents.planners.common.robot_files import variant_name
from agents.policies.learned.features import FeatureView
from agents.policies.learned.network import Network
from agents.policies.learned.policy_file import PlanFormat, PolicyFile, load_policy_file
from agents.policies.learned.trained import trained_policy


class Progress:
    """Writes the results of a run to its folder while it learns.

    Args:
        session: of the run.
        view: what the network sees.
        checkpoint: of an earlier session, None if there was none.
        plans: meaning of the network's outputs; None if they are actions.
    """

    def __init__(
        self,
        session: Session,
        view: FeatureView,
        checkpoint: dict[str, Any] | None = None,
        plans: PlanFormat | None = None,
    ) -> None:
        self.session, self.view, self._plans = session, view, plans
        self.folder, self.settings, self.budget = session.folder, session.settings, session.budget
        self.history: list[dict[str, Any]] = checkpoint["history"] if checkpoint else []
        self.logger: Logger = configure(str(self.folder.tensorboard), ["tensorboard"])
        self.bar = tqdm(
            total=session.parameters.steps,
            initial=checkpoint["steps"] if checkpoint else 0,
            unit="step",
            unit_scale=True,
            desc=self.settings.algorithm,
            disable=session.quiet or not sys.stderr.isatty(),
        )
        self._validate = Validator(self.settings.env_id, session.episodes, **self.settings.environment)
        self._best: tuple[float, float] | None = None
        if self.folder.policy.exists():
            self._best = Validation(**load_policy_file(self.folder.policy).notes["validation"]).order

    def checkpoint(
        self, steps: int, network: Network, state: dict[str, Any], candidate: bool = True
    ) -> Validation:
        """Validate the network, save it if it is the best so far, write a checkpoint that holds `state`.

        Args:
            candidate: whether it may be saved: not while it is still the policy that the run started from.
        """
        file = self._policy_file(steps, network)
        result = self._validate(trained_policy(file, self._validate.context, search=False))
        if candidate and (self._best is None or result.order > self._best):
            self._best = result.order
            replace(file, notes={**file.notes, "validation": result.to_json()}).save(self.folder.policy)
        self.history.append({"steps": steps, "wall_s": round(self.budget.wall, 1), **result.to_json()})
        self.folder.write_validation(self.history)
        times = {"wall": self.budget.wall, "cpu": self.budget.cpu}
        self.folder.write_checkpoint({"steps": steps, "times": times, "history": self.history, **state})
        for name, value in result.to_json().items():
            self.logger.record(f"validation/{name}", value)
        self.logger.dump(steps)
        if not self.session.quiet:
            tqdm.write(self._line(steps, result))
        return result

    def _line(self, steps: int, result: Validation) -> str:
        return (
            f"{self.settings.algorithm:>4} {steps:>9,} steps {self.budget.wall:>6.0f} s   "
            f"score {result.score:.3f}   captured {100 * result.captured:5.1f} %   "
            f"return {result.episode_return:6.2f}   "
            f"attitude {result.final_attitude:5.2f} deg   "
            f"base disturbance (eq. 20) {1e4 * result.attitude_cost:.1f} cm^2/s   "
            f"{result.seconds:4.1f} s an episode"
        )

    def finish(self, steps: int) -> dict[str, Any]:
        """Mark the run as finished; returns its summary."""
        best = load_policy_file(self.folder.policy).notes
        start = self._start()
        summary = {
            "algorithm": self.settings.algorithm,
            "steps": steps,
            "best_steps": best["steps"],
            "validation": best["validation"],
            "start": None if start is None else start.to_json(),
            "improved": None if start is None else Validation(**best["validation"]).order > start.order,
            "wall_s": round(self.budget.wall, 1),
            "cpu_s": round(self.budget.cpu, 1),
        }
        self.folder.write_summary(summary)
        return summary

    def _start(self) -> Validation | None:
        """Validation of the policy that the run started from, None if it started from none."""
        first = self.history[0]
        if first["steps"] > 0:
            return None
        return Validation(**{field.name: first[field.name] for field in fields(Validation)})

    def close(self) -> None:
        """End the progress bar and the log."""
        self.bar.close()
        self.logger.close()

    def _policy_file(self, steps: int, network: Network) -> PolicyFile:
        settings, robot = self.settings, self._validate.env.task.robot
        notes = {
            "algorithm": settings.algorithm,
            "difficulty": settings.difficulty,
            "env_kwargs": settings.env_kwargs,
            "seed": settings.seed,
            "knowledge": knowledge_of(settings.init, self.session.parameters),
            "steps": steps,
        }
        return PolicyFile(
            env_id=self._validate.env.env_id,
            control_mode=settings.control_mode,
            robots={robot.digest: variant_name(robot)},
            network=network,
            features=self.view.table,
            home=tuple(self.view.home.tolist()),
            notes=notes,
            plans=self._plans,
        )
