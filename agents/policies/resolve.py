"""Policies from the names, paths and files that a user gives."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from agents.policies.learned.learned_policy import policy_path
from agents.policies.learned.policy_file import load_policy_file
from agents.policies.learned.sb3_policy import StableBaselinesPolicy
from agents.policies.learned.sb3_zip import load_network
from agents.policies.learned.trained import load_trained
from agents.policies.registry import POLICIES, control_mode, knowledge, make_policy
from space_envs.errors import ConfigurationError, no_path, unknown_name
from space_envs.foreign_code import undisturbed
from space_envs.policy import DEFAULT_CONTROL_MODE, Knowledge, Policy, PolicyContext

ZIP = ".zip"  # suffix of files of stable-baselines3


@dataclass(frozen=True)
class ResolvedPolicy:
    """An existing policy as plain data, so that another process can build it too.

    Attributes:
        name: in tables. control_mode: of its actions.
        source: registered name or `package.module:Class`; or the absolute path of a file.
        knowledge: that it is made of, as it states.
    """

    name: str
    control_mode: str
    source: str | Path
    knowledge: Knowledge = Knowledge.UNSTATED

    @property
    def foreign(self) -> bool:
        """Whether its code is not part of this project and therefore runs in a process of its own."""
        return isinstance(self.source, str) and self.source not in POLICIES

    def build(self, context: PolicyContext, seed: int) -> Policy:
        """The policy for an environment.

        Raises:
            ConfigurationError, PolicyError: if it cannot be loaded or does not fit the environment.
        """
        if isinstance(self.source, str):
            return make_policy(self.source, context, seed)
        if self.source.suffix == ZIP:
            return StableBaselinesPolicy(context, seed, self.source)
        return load_trained(self.source, context, seed)

    def factory(self, seed: int) -> Callable[[PolicyContext], Policy]:
        """Function that builds the policy with a seed."""
        return partial(self.build, seed=seed)


def resolve_policy(name: str, mode: str | None = None) -> ResolvedPolicy:
    """Find a policy by its registered name, as `package.module:Class`, or as a run's folder or a file.

    Args:
        name: given by the user; a file is from `train.py`, or a zip of stable-baselines3.
        mode: control mode to use instead of the policy's default.

    Raises:
        ConfigurationError: if there is nothing of that name. PolicyError: if it cannot be loaded.
    """
    if name in POLICIES:
        return ResolvedPolicy(name, mode or control_mode(name), name, knowledge(name))
    if ":" in name:
        with undisturbed():
            return ResolvedPolicy(name, mode or control_mode(name), name, knowledge(name))
    if not name.strip():
        raise ConfigurationError("a policy needs a name, got an empty text")
    path = Path(name)
    if not path.exists():
        if len(path.parts) > 1 or path.suffix in (ZIP, ".npz"):
            raise _no_path(path)
        valid = [*POLICIES, "package.module:Class", "a run's folder", f"a {ZIP} of stable-baselines3"]
        raise unknown_name("policy", name, valid)
    label = path.stem if path.is_file() else path.resolve().name
    if path.is_file() and path.suffix == ZIP:
        load_network(path)
        return ResolvedPolicy(label, mode or DEFAULT_CONTROL_MODE, path.resolve())
    source = policy_path(path).resolve()
    file = load_policy_file(source)
    return ResolvedPolicy(label, mode or file.control_mode, source, file.knowledge)


def _no_path(path: Path) -> ConfigurationError:
    """Error for a run's folder or file that does not exist, with the nearest name next to it."""
    usual = "policy file" if path.suffix else "run's folder"
    what = "zip of stable-baselines3" if path.suffix == ZIP else usual
    siblings = sorted(each.name for each in path.parent.iterdir()) if path.parent.is_dir() else []
    return no_path(what, path, siblings)
