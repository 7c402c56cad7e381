"""Policies whose network gives paths in the reaction null space, corrected, with a search behind them."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.amortised.planner import MOST_CORRECTIONS
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.improvement import Effort
from agents.planners.single_arm.reactionless.paths import FUNCTIONS
from agents.planners.single_arm.reactionless.planner import Guess
from agents.policies.learned.learned_policy import check_trained_for, missing_weights, shipped_file_of
from agents.policies.learned.planner_network import needs_pose
from agents.policies.learned.policy_file import PolicyFile
from agents.policies.single_arm.reactionless.policy import PrompReactionless
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.policy import Knowledge, PolicyContext

GAIN = 1e-2  # relative decrease of the disturbance below which no further correction is made


class ReactionlessNetwork(PrompReactionless):
    """Follows the path that a network of `train.py --algo planner --kind reactionless` gives.

    Args:
        file: the network. corrections: iterations of a search within the limits from its path, where that
            does not keep them; 0 only moves its end onto the goal. search: whether the search of
            `promp_reactionless` follows where that leads to no plan.

    Raises:
        PolicyError: if the file is no such network, or was trained for another id, control mode or robot.
        ConfigurationError: for corrections that are none.
    """

    needs = replace(PrompReactionless.needs, goals="static", obstacles=False, other=needs_pose)
    knowledge = Knowledge.LEARNED_WITH_MODEL

    def __init__(
        self, context: PolicyContext, seed: int, file: PolicyFile, corrections: int = 6, search: bool = False
    ) -> None:
        super().__init__(context, seed)
        check_trained_for(file, context)
        if file.plans is None or file.plans.kind != "reactionless":
            raise PolicyError("the network gives no paths in the reaction null space")
        if not 0 <= corrections <= MOST_CORRECTIONS:
            raise ConfigurationError(f"corrections must lie in 0..{MOST_CORRECTIONS}, got {corrections!r}")
        self._network, self._view = file.network, file.view(context.layout)
        self._effort, self._search = Effort(corrections, GAIN), search

    def plan(self, asked: list[Reach], observation: Array | None = None) -> list[ReachPlan | Failure]:
        """Plans of all rows, which are of observations (N, size)."""
        if observation is None:
            return super().plan(asked)
        output = self._network.means(self._view(observation)).astype(np.float64)
        paths = output.reshape(len(output), FUNCTIONS, output.shape[1] // FUNCTIONS).swapaxes(1, 2)
        return [
            self.planner.plan(reach, Guess(np.ascontiguousarray(path), self._effort, self._search))
            for reach, path in zip(asked, paths, strict=True)
        ]


class ShippedReactionlessNetwork(ReactionlessNetwork):
    """The network that ships, with corrections, and the search where they lead to no plan."""

    name: ClassVar[str] = "reactionless_network"
    search: ClassVar[bool] = True
    needs = replace(
        ReactionlessNetwork.needs, other=lambda c: needs_pose(c) or missing_weights("reactionless_network", c)
    )

    def __init__(self, context: PolicyContext, seed: int = 0, **options: Any) -> None:
        options.setdefault("search", self.search)
        super().__init__(context, seed, shipped_file_of(self.name, context), **options)


class ReactionlessNetworkAlone(ShippedReactionlessNetwork):
    """The network that ships, with corrections alone."""

    search = False
