"""A training run from its beginning, or from where it was killed, to its end."""

from dataclasses import replace
from typing import Any

from agents.learning.cloning import Cloning
from agents.learning.hyperparameters import BC, PPO, AnyHyperparameters, hyperparameters
from agents.learning.recorder import Recorder
from agents.learning.reinforcement import Reinforcement
from agents.learning.runs import Budget, RunFolder, Settings
from agents.learning.validation import EPISODES
from agents.policies.learned.learned_policy import policy_path
from agents.policies.learned.policy_file import PolicyFile, load_policy_file
from space_envs.errors import PolicyError
from space_envs.system.threads import on_one_thread


def learn(folder: RunFolder, episodes: int = EPISODES, quiet: bool = False) -> dict[str, Any]:
    """Carry out the run that `RunFolder.begin` wrote down, going on from its checkpoint if there is one.

    ppo first clones its table's expert, in the folder `clone` of the run, unless it starts from another run.

    Args:
        episodes: of the validation split that are played at every interval.
        quiet: neither progress bar nor lines.

    Returns:
        The summary: steps, the best policy's steps and validation, the validation of the policy that the
        run started from and whether the best improved on it (None without one), wall and processor time in s.

    Raises:
        ConfigurationError, PolicyError: if something that was asked for does not exist or does not fit.
    """
    # The networks are small: two threads are ten times slower than one, and give other bits.
    on_one_thread()
    settings, parameters = folder.restore()
    checkpoint = folder.checkpoint()
    times = checkpoint["times"] if checkpoint else {"wall": 0.0, "cpu": 0.0}
    limit = None if parameters.minutes is None else 60.0 * parameters.minutes
    return _learn(
        folder, settings, parameters, checkpoint, Budget(limit, times["wall"], times["cpu"]), episodes, quiet
    )


def _learn(
    folder: RunFolder,
    settings: Settings,
    parameters: AnyHyperparameters,
    checkpoint: dict[str, Any] | None,
    budget: Budget,
    episodes: int,
    quiet: bool,
) -> dict[str, Any]:
    done: int = checkpoint["steps"] if checkpoint else 0
    learner: Cloning | Reinforcement
    if isinstance(parameters, BC):
        learner = Cloning(folder, settings, parameters)
        if checkpoint:
            learner.restore(checkpoint, done)
    else:
        start = None
        if checkpoint is None and isinstance(parameters, PPO):
            start = _start(folder, settings, parameters, budget, episodes, quiet)
        learner = Reinforcement(settings, parameters, budget, budget.wall)
        if checkpoint:
            learner.restore(checkpoint)
        elif start is not None:
            learner.start_from(start.network)
    history = checkpoint["history"] if checkpoint else []
    recorder = Recorder(folder, settings, parameters, budget, learner.view, history, done, episodes, quiet)
    try:
        if isinstance(learner, Reinforcement) and learner.warm and not history:
            learner.record(recorder, candidate=False)  # what the run starts from, to compare with
        done = learner.run(recorder, done) if isinstance(learner, Cloning) else learner.run(recorder)
        summary = recorder.finish(done)
    finally:
        recorder.close()
    if isinstance(learner, Cloning):
        learner.forget()
    return summary


def _start(
    folder: RunFolder, settings: Settings, parameters: PPO, budget: Budget, episodes: int, quiet: bool
) -> PolicyFile | None:
    """The policy that ppo starts from, cloned now if need be."""
    if settings.init is not None:
        return starting_policy(settings, parameters)
    if parameters.expert is None:
        return None
    clone = RunFolder(folder.path / "clone")
    if finished := clone.summary():
        budget.used += finished["wall_s"]
        budget.used_cpu += finished["cpu_s"]
    else:
        copy = replace(settings, algorithm="bc")
        table = clone_table(settings, parameters)
        checkpoint = None
        if clone.exists():
            checkpoint = clone.checkpoint()
            if checkpoint:
                budget.used += checkpoint["times"]["wall"]
                budget.used_cpu += checkpoint["times"]["cpu"]
        else:
            clone.begin(copy, table)
        _learn(clone, copy, table, checkpoint, budget, episodes, quiet)
    return load_policy_file(clone.policy)


def clone_table(settings: Settings, parameters: PPO) -> BC:
    """Hyperparameters of the cloning that precedes ppo: the task's own, with ppo's network and expert."""
    table = hyperparameters(settings.env_id, "bc")
    if not isinstance(table, BC) or parameters.expert is None:
        raise TypeError("the table of bc must be a BC, and ppo must have an expert")
    return replace(
        table,
        expert=parameters.expert,
        hidden=parameters.hidden,
        activation=parameters.activation,
        features=parameters.features,
    )


def starting_policy(settings: Settings, parameters: PPO) -> PolicyFile:
    """The policy that `init` names, checked against what ppo will train.

    Raises:
        PolicyError: if there is none, or it was trained for another task or network.
    """
    file = load_policy_file(policy_path(str(settings.init)))
    for name, got, wanted in (
        ("environment id", file.env_id, settings.env_id),
        ("control mode", file.control_mode, settings.control_mode),
        ("features", file.features, parameters.features),
        ("hidden layers", tuple(len(bias) for bias in file.network.biases[:-1]), parameters.hidden),
        ("activation", file.network.activation, parameters.activation),
        ("squashing", file.network.squash, False),
    ):
        if got != wanted:
            raise PolicyError(
                f"cannot start from {settings.init}: its {name} is {got!r}, this run has {wanted!r}"
            )
    return file
