"""Files of others are read or refused with a reason, whatever bytes they hold; nothing hangs or ends."""

import io
import json
import os
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from offenders import assert_none
from synthetic_results import CHARACTERS, make_episodes

from agents.demonstrations import storage as demonstrations
from agents.learning.runs.nested_npz import load_nested, save_nested
from agents.policies.learned.learned_policy import shipped_path
from agents.policies.learned.policy_file import load_policy_file
from agents.policies.resolve import resolve_policy
from promp.errors import StorageError
from promp.storage import load_arrays
from space_envs.errors import ConfigurationError, PolicyError, SpaceEnvsError
from space_envs.evaluation.datasets.card import CARD, read_card
from space_envs.evaluation.datasets.storage import Dataset
from space_envs.evaluation.play.episode_file import load_episodes, save_episodes
from space_envs.evaluation.records.storage import read_records
from space_envs.system.reading import parse_arrays, read_arrays, read_object

SHIPPED = shipped_path("SpaceCapture/SingleArm-v0", "bc")
READERS: dict[str, Callable[[Path], Any]] = {
    "arrays": read_arrays,
    "object": read_object,
    "policy": load_policy_file,
    "episodes": load_episodes,
    "dataset": Dataset.load,
    "demonstrations": demonstrations.load,
    "checkpoint": load_nested,
    "records": read_records,
    "promp": lambda path: load_arrays(path, ("a",)),
}
REFUSED = (SpaceEnvsError, StorageError)


def npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def claiming(header: str, data: bytes = b"") -> bytes:
    """An npz whose one array has this header."""
    text = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    member = b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text + data
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("a.npy", member)
    return buffer.getvalue()


HOSTILE = {
    "empty": b"",
    "text": b"hello\n",
    "deep": b"[" * 100_000,
    "null": b"null\n",
    "number": b"5\n",
    "list": b"[]\n",
    "terabytes": claiming("{'descr': '<f8', 'fortran_order': False, 'shape': (550000000000,)}", b"x" * 64),
    "negative": claiming("{'descr': '<f8', 'fortran_order': False, 'shape': (-8,)}", b"x" * 64),
    "deep header": claiming("(" * 4000 + ")" * 4000),
    "long header": claiming("{'descr': '<f8'}" + " " * 20_000),
    "objects": npz(a=np.zeros(3)).replace(b"<f8", b"|O "),
    "no arrays": npz(),
    "other arrays": npz(nothing=np.zeros(3)),
    "texts": npz(a=np.array("x"), header=np.array("{}"), about=np.array("3"), tree=np.array("[[")),
}


def test_what_is_nested_too_deeply_is_said_to_be(tmp_path: Path) -> None:
    path = tmp_path / "records.jsonl"
    path.write_text("[" * 100_000 + "\n")
    for read in (read_records, read_object):
        with pytest.raises(ConfigurationError, match=r"not (a )?JSON( object)?: nested too deeply$"):
            read(path)


HARMLESS = {("records", "empty"), *(("arrays", name) for name in ("no arrays", "other arrays", "texts"))}


def misread(reader: str, path: Path) -> str | None:
    """Outcome of reading a file that has to be refused by name, or None if it is as it should be."""
    try:
        READERS[reader](path)
    except REFUSED as error:
        if "allow_pickle" in str(error) or not (reader in ("arrays", "object") or str(path) in str(error)):
            return f"unhelpful: {error}"
        return None
    return "accepted"


def test_hostile_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"

    def offenders() -> Iterator[str]:
        for content, data in HOSTILE.items():
            path.write_bytes(data)
            for reader in READERS:
                expected = "accepted" if (reader, content) in HARMLESS else None
                if (found := misread(reader, path)) != expected:
                    yield f"{content} by {reader}: {found}"

    assert_none(offenders())


def test_a_named_pipe_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    for read in READERS.values():
        with pytest.raises((*REFUSED, OSError), match="not a regular file"):
            read(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A sound file of several kinds."""
    folder = tmp_path_factory.mktemp("whole")
    made = make_episodes("mpc", CHARACTERS["mpc"], np.random.default_rng(0), count=1)
    save_episodes(folder / "episodes", made)
    save_nested(folder / "checkpoint", {"a": np.arange(4.0), "b": [1, "two", None]})
    (folder / "policy").write_bytes(SHIPPED.read_bytes()[:4000] + SHIPPED.read_bytes()[-4000:])
    return {path.stem: path.read_bytes() for path in folder.iterdir()} | {"arrays": npz(a=np.arange(5.0))}


@given(data=st.data())
def test_damaged_bytes_never_raise_anything_else(data: st.DataObject, whole, tmp_path_factory) -> None:
    name = data.draw(st.sampled_from(sorted(whole)))
    content = bytearray(whole[name])
    for _ in range(data.draw(st.integers(1, 4))):
        # The ends hold the headers and the table of contents.
        place = data.draw(st.integers(0, min(400, len(content) - 1)))
        place = place if data.draw(st.booleans()) else len(content) - 1 - place
        content[place] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_bytes(content)
    try:
        READERS[name](path)
    except REFUSED:
        pass


@given(st.dictionaries(st.text("abc", min_size=1), st.integers(0, 5), max_size=3), st.sampled_from("fF?iU"))
def test_whole_arrays_come_back(sizes: dict[str, int], kind: str) -> None:
    dtype = {"f": "<f4", "F": "<f8", "?": "?", "i": "<i8", "U": "<U3"}[kind]
    arrays = {name: np.zeros((size, 2), dtype).T if kind == "F" else np.ones(size, dtype) for name, size in
              sizes.items()}  # fmt: skip
    found = parse_arrays(npz(**arrays))
    assert set(found) == set(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype and found[name].shape == array.shape


def changed(**values: Any) -> bytes:
    arrays = read_arrays(SHIPPED)
    header = json.loads(str(arrays.pop("header"))) | values
    return npz(header=np.array(json.dumps(header)), **arrays)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"home": [float("nan")] * 7}, "home must hold finite"),
        ({"home": ["0"] * 7}, "home must hold finite"),
        ({"home": [True] * 7}, "home must hold finite"),
        ({"home": "0000000"}, "home must be list"),
        ({"squash": "no"}, "squash must be bool, got 'no'"),
        ({"squash": 1}, "squash must be bool"),
        ({"env_id": 3}, "env_id must be str"),
        ({"control_mode": "joint_velocty"}, "Did you mean 'joint_velocity'"),
        ({"notes": []}, "notes must be dict"),
        ({"format": True}, "format must be int"),
        ({"format": 3}, "format 3 is not known"),
        ({"activation": ["tanh"]}, "activation must be str"),
        ({"features": [["joint_position", "plain", True]]}, "scale of feature joint_position"),
        ({"features": [["joint_position", "plain", float("inf")]]}, "scale of feature joint_position"),
        ({"features": [3]}, "a feature must be"),
        ({"features": [{"a": 1, "b": 2, "c": 3}]}, "a feature must be"),
    ],
)
def test_every_field_of_a_policy_file_is_checked(values: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = tmp_path / "policy.npz"
    path.write_bytes(changed(**values))
    with pytest.raises(PolicyError, match=said):
        load_policy_file(path)


def test_home_has_an_angle_for_each_joint(tmp_path: Path) -> None:
    from space_envs.tasks.single_arm import SingleArmTask

    path = tmp_path / "policy.npz"
    path.write_bytes(changed(home=[1.0]))
    with pytest.raises(PolicyError, match="home has 1 joint angles, joint_position of the observation 7"):
        load_policy_file(path).view(SingleArmTask().layout)


def test_arrays_that_no_network_has_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.npz"
    arrays = read_arrays(SHIPPED)
    path.write_bytes(npz(**arrays, more=np.zeros(3, np.float32)))
    with pytest.raises(PolicyError, match="it holds the arrays"):
        load_policy_file(path)


def test_a_text_given_as_policy_is_said_to_be_none(tmp_path: Path) -> None:
    path = tmp_path / "some.txt"
    path.write_text("hello")
    with pytest.raises(PolicyError, match=r"some\.txt is not a policy file: not an npz archive"):
        resolve_policy(str(path))


@pytest.mark.parametrize("text", ["[]", "null", "5", "[" * 100_000, '{"schema": 1, "files": 3}', "{"])
def test_malformed_cards_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / CARD).write_text(text)
    with pytest.raises(ConfigurationError, match=CARD):
        read_card(tmp_path)
