"""Third-party policies that misbehave, for the tests of the harness."""

import os
import time

import numpy as np

from agents.policies.single_arm.gjm import GeneralizedJacobian
from space_envs.errors import PlanningError
from space_envs.policy import PolicyContext

AT = 3  # step at which they misbehave


class Well(GeneralizedJacobian):
    """Behaves, and knows how to tell goals apart."""

    at = AT

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self.period = context.control_period

    def bad(self, observation: np.ndarray) -> np.ndarray:
        """Rows (N,) in which a subclass misbehaves now: goals on one side, at one time."""
        read = self.context.layout.read
        step = np.rint(read(observation, "time")[:, 0] / self.period)
        return (step == self.at) & chosen(read(observation, "goal_position"))


def chosen(goal: np.ndarray) -> np.ndarray:
    """Goals (N, 3) of which a policy does not know what to do: about a fifth of them."""
    return goal[:, 0] > 0.0


class Raises(Well):
    """Raises if any of the rows is a goal it does not like."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.bad(observation).any():
            raise ValueError("a goal that I do not like")
        return super().predict(observation, state, episode_start, deterministic)


class HasNoPlan(Well):
    """Says so in the way of planners."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        raise PlanningError("the goal is out of reach")


class NaNs(Well):
    """Returns NaN in such rows."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        action, state = super().predict(observation, state, episode_start, deterministic)
        return np.where(self.bad(observation)[:, None], np.nan, action), state


class Shapes(Well):
    """Returns one action too many where there is such a row."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        action, state = super().predict(observation, state, episode_start, deterministic)
        return (np.hstack([action, action]) if self.bad(observation).any() else action), state


class Sleeps(Well):
    """Takes its time where there is such a row."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.bad(observation).any():
            time.sleep(60.0)
        return super().predict(observation, state, episode_start, deterministic)


class Ponders(Sleeps):
    """Takes its time to begin with."""

    at = 0


class Dies(Well):
    """Takes its process with it where there is such a row."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.bad(observation).any():
            os._exit(3)
        return super().predict(observation, state, episode_start, deterministic)


class Leaves(Well):
    """Leaves the program where there is such a row."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.bad(observation).any():
            raise SystemExit(4)
        return super().predict(observation, state, episode_start, deterministic)


class Prints(Well):
    """Writes to standard output, which is none of the harness's pipes."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        print("thinking")
        return super().predict(observation, state, episode_start, deterministic)


class Unbuilt:
    """Takes no seed."""

    def __init__(self, context):
        raise ValueError("never reached")

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation), 7)), state


class ClosesEverything(Well):
    """Closes all files of its process, those through which it answers too."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if self.bad(observation).any():
            os.closerange(3, 256)
        return super().predict(observation, state, episode_start, deterministic)
