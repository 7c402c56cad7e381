"""Datasets in the format of Minari (the extra `minari`)."""

import os
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium as gym

from space_envs.errors import ConfigurationError
from space_envs.evaluation.datasets.storage import Dataset

ROOT_VARIABLE = "MINARI_DATASETS_PATH"
DATA = "data"  # Minari's folder inside that of a dataset
_STAGING = ".unfinished"


def require_minari() -> None:
    """Refuse to begin where Minari is not installed.

    Raises:
        ConfigurationError: naming the extra.
    """
    missing = [name for name in ("minari", "h5py") if find_spec(name) is None]
    if missing:
        raise ConfigurationError(
            f"format 'minari' needs {' and '.join(missing)}: pip install 'space-capture[minari]'"
        )


def write_minari(
    dataset: Dataset, dataset_id: str, root: Path, description: str, keywords: Mapping[str, Any]
) -> None:
    """Write a Minari dataset into `root`, whole or not at all; an older one is replaced.

    Each episode's metadata has its seed, the options of its `reset`, its outcome and whether it captured.

    Args:
        dataset_id: with namespaces and version. root: what Minari calls its datasets path.
        description: for its metadata. keywords: of `gym.make`, with the id as `id`.
    """
    import minari
    from minari.data_collector import EpisodeBuffer
    from minari.namespace import create_namespace, list_local_namespaces

    folder = root / dataset_id
    staging = folder / _STAGING
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    env = gym.make(**keywords)
    trajectories = [dataset.trajectory(k) for k in range(len(dataset))]
    split = dataset.about["split"]
    buffers = [
        EpisodeBuffer(
            id=k,
            seed=one.seed,
            options={"split": split, "index": one.index},
            observations=one.observations,  # pyright: ignore[reportArgumentType]
            actions=one.actions,  # pyright: ignore[reportArgumentType]
            rewards=one.rewards.tolist(),
            terminations=one.terminations.tolist(),
            truncations=one.truncations.tolist(),
        )
        for k, one in enumerate(trajectories)
    ]
    with warnings.catch_warnings():
        # Minari asks for the address of an author and of the code, which are in no one's dataset.
        warnings.simplefilter("ignore", UserWarning)
        with datasets_path(staging):
            made = minari.create_dataset_from_buffers(
                dataset_id=dataset_id,
                buffer=buffers,
                env=env,
                algorithm_name=dataset.about["policy"],
                description=description,
                requirements=["space-capture"],
            )
        made.storage.update_episode_metadata(
            {"outcome": one.outcome, "captured": one.captured} for one in trajectories
        )
        env.close()
        shutil.rmtree(folder / DATA, ignore_errors=True)
        os.replace(staging / dataset_id / DATA, folder / DATA)
        shutil.rmtree(staging)
        with datasets_path(root):
            namespace = dataset_id.rpartition("/")[0]
            if namespace not in list_local_namespaces():
                create_namespace(namespace)


@contextmanager
def datasets_path(root: Path) -> Iterator[None]:
    """Context in which Minari stores its datasets in this folder instead of the user's."""
    before = os.environ.get(ROOT_VARIABLE)
    os.environ[ROOT_VARIABLE] = str(root.resolve())
    try:
        yield
    finally:
        if before is None:
            del os.environ[ROOT_VARIABLE]
        else:
            os.environ[ROOT_VARIABLE] = before
