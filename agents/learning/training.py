"""A training run from its start, or from its last checkpoint, to its end."""

from dataclasses import replace
from typing import Any

from agents.learning.cloning import Cloning
from agents.learning.planners.training import PlannerTraining
from agents.learning.progress import Progress
from agents.learning.reinforcement import Reinforcement
from agents.learning.runs.defaults import default_hyperparameters
from agents.learning.runs.folder import RunFolder
from agents.learning.runs.hyperparameters import BC, PPO, AnyHyperparameters, OffPolicy, Planner
from agents.learning.runs.session import Budget, Session
from agents.learning.runs.settings import Settings
from agents.learning.runs.warm_start import starting_policy
from agents.policies.learned.network import Network
from agents.policies.learned.policy_file import load_policy_file
from space_envs.system.threads import on_one_thread

Checkpoint = dict[str, Any]


def learn(folder: RunFolder, episodes: int | None = None, quiet: bool = False) -> dict[str, Any]:
    """Train the run that `RunFolder.create` described, from its checkpoint if there is one.

    An expert is first cloned, in the folder `clone` of the run, unless it starts from another run.

    Args:
        episodes: of the validation split that are played at every interval; None takes the usual number.
        quiet: neither progress bar nor lines.

    Returns:
        The summary: steps, the best policy's steps and validation, the validation of the policy that the
        run started from and whether the best improved on it (None without one), wall and processor time in s.

    Raises:
        ConfigurationError, PolicyError: if something that the settings name does not exist or does not fit.
    """
    # The networks are small: two threads are ten times slower than one, and give other bits.
    on_one_thread()
    settings, parameters = folder.restore()
    checkpoint = folder.checkpoint()
    budget = Budget(None if parameters.minutes is None else 60.0 * parameters.minutes)
    if checkpoint is not None:
        budget.add(**checkpoint["times"])
    return _learn(Session(folder, settings, parameters, budget, episodes, quiet), checkpoint)


def _learn(session: Session, checkpoint: Checkpoint | None) -> dict[str, Any]:
    learner = _learner(session, checkpoint)
    plans = learner.plans if isinstance(learner, PlannerTraining) else None
    progress = Progress(session, learner.view, checkpoint, plans)
    try:
        summary = progress.finish(learner.run(progress))
    finally:
        progress.close()
    if isinstance(learner, Cloning):
        learner.forget()
    return summary


def _learner(session: Session, checkpoint: Checkpoint | None) -> Cloning | Reinforcement | PlannerTraining:
    """The learner at its checkpoint; without one it is at the network that it starts from."""
    start = _start(session) if checkpoint is None else None
    kinds = {BC: Cloning, Planner: PlannerTraining}
    learner = kinds.get(type(session.parameters), Reinforcement)(session)
    if checkpoint is not None:
        learner.restore(checkpoint)
    elif start is not None and isinstance(learner, Reinforcement):
        learner.start_from(start)
    return learner


def _start(session: Session) -> Network | None:
    """The network that learning starts from, cloned now if need be."""
    settings, parameters = session.settings, session.parameters
    if isinstance(parameters, BC | Planner):
        return None
    if settings.init is not None:
        return starting_policy(settings.init, settings.context(), parameters).network
    return None if parameters.expert is None else _clone(session, parameters)


def _clone(session: Session, parameters: PPO | OffPolicy) -> Network:
    """The network that cloning the expert gives; the time that it takes counts."""
    clone = RunFolder(session.folder.path / "clone")
    if finished := clone.summary():
        session.budget.add(finished["wall_s"], finished["cpu_s"])
        return load_policy_file(clone.policy).network
    settings, cloning = (
        replace(session.settings, algorithm="bc"),
        clone_hyperparameters(session.settings, parameters),
    )
    checkpoint = clone.checkpoint() if clone.exists() else None
    if not clone.exists():
        clone.create(settings, cloning)
    if checkpoint is not None:
        session.budget.add(**checkpoint["times"])
    _learn(replace(session, folder=clone, settings=settings, parameters=cloning), checkpoint)
    return load_policy_file(clone.policy).network


def clone_hyperparameters(settings: Settings, parameters: PPO | OffPolicy) -> AnyHyperparameters:
    """Hyperparameters of the cloning that comes first: the id's own, with the run's network and expert."""
    names = ("expert", "hidden", "activation", "features")
    context = settings.context()
    given = {name: getattr(parameters, name) for name in names}
    return default_hyperparameters(context.env_id, "bc", context.layout, given)
