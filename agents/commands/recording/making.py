"""Recording of datasets: episodes in parallel, each dataset written when it is complete."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

from joblib import delayed
from tqdm import tqdm

from agents.commands.recording.request import DatasetFolders, DatasetRequest
from space_envs.errors import PolicyError
from space_envs.evaluation.datasets.card import EPISODES, make_card, write_card
from space_envs.evaluation.datasets.minari import write_minari
from space_envs.evaluation.datasets.recording import Recorded, record
from space_envs.evaluation.datasets.storage import Dataset
from space_envs.evaluation.play.chunks import Chunk
from space_envs.registration import find
from space_envs.system.digests import file_digest
from space_envs.system.parallel import ProcessDiedError, backend
from space_envs.system.provenance import provenance


def make(
    requests: Sequence[DatasetRequest], folders: DatasetFolders, jobs: int
) -> Iterator[tuple[DatasetRequest, dict[str, Any]]]:
    """Record the datasets in parallel, write each as soon as it is complete, and yield its card.

    Raises:
        PolicyError: if a policy ended its process; complete datasets remain.
    """
    chunks = [(number, chunk) for number, request in enumerate(requests) for chunk in request.chunks()]
    if not chunks:
        return
    missing = [sum(number == of for of, _ in chunks) for number in range(len(requests))]
    parts: list[list[Recorded]] = [[] for _ in requests]
    total = sum(len(chunk.indices) for _, chunk in chunks)
    bar = tqdm(total=total, unit="episode", leave=False, smoothing=0.0)
    with bar, backend(min(jobs, len(chunks))) as spread:
        try:
            for number, episodes, recorded in spread(delayed(_recorded)(*pair) for pair in chunks):
                bar.update(episodes)
                parts[number].append(recorded)
                missing[number] -= 1
                if missing[number] == 0:
                    yield requests[number], _written(requests[number], parts[number], folders)
                    parts[number] = []
        except ProcessDiedError:
            raise PolicyError("a process died while a policy acted in it; complete datasets remain") from None


def _recorded(number: int, chunk: Chunk) -> tuple[int, int, Recorded]:
    return number, len(chunk.indices), record(chunk)


def _written(request: DatasetRequest, parts: Sequence[Recorded], folders: DatasetFolders) -> dict[str, Any]:
    """Write a dataset and return its card; the card of an empty dataset lists only the omitted episodes."""
    folder = folders.folder(request)
    written = sorted(chain(*(part.trajectories for part in parts)), key=lambda one: one.episode)
    omitted = sorted(chain(*(part.omitted for part in parts)), key=lambda one: one.episode)
    if request.captured_only:
        written = [one for one in written if one.captured]
    if not written:
        return {"episodes": {"written": 0, "captured": 0, "omitted": [vars(one) for one in omitted]}}
    values = request.to_json()
    names = ("env_id", "robot", "robot_digest", "policy", "control_mode", "difficulty", "split", "goal")
    about = {name: values[name] for name in (*names, "perturbation") if name in values}
    dataset = Dataset.of(about, written)
    origin = provenance(request.command(), [request.seed])
    card = make_card(values, origin, dataset, omitted, request.make_env())
    card["files"] = {}
    if "npz" in request.formats:
        dataset.save(folder / EPISODES)
        card["files"] = {EPISODES: file_digest(folder / EPISODES)}
    if "minari" in request.formats:
        keywords = {"id": find(request.task.env_id).name, **request.plain_keywords}
        about = f"Made by: {request.command()}"
        write_minari(dataset, request.id, folders.minari, about, keywords)
        card["minari"] = {"dataset_id": request.id}
    write_card(folder, card)
    return card
