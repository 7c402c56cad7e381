"""ProMP files: a round trip, equal bytes, and a clear refusal of everything that is not whole."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from promp import GaussianBasis, ProMP, StorageError
from promp.storage import checksum, save_arrays


def make_promp():
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((8, 5))
    basis = GaussianBasis((0.0, 0.25, 0.75, 1.0), 0.3)
    return ProMP(rng.standard_normal((2, 4)), directions @ directions.T, basis)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A saved ProMP, as bytes, and a path to write damaged copies to."""
    folder = tmp_path_factory.mktemp("promp")
    make_promp().save(folder / "whole.npz")
    return (folder / "whole.npz").read_bytes(), folder / "damaged.npz"


def same(first, second):
    return (
        np.array_equal(first.mean, second.mean)
        and np.array_equal(first.covariance, second.covariance)
        and first.basis == second.basis
    )


def test_round_trip_and_equal_bytes(tmp_path):
    saved, first, second = make_promp(), tmp_path / "new" / "first.npz", tmp_path / "new" / "second.npz"
    saved.save(first)
    loaded = ProMP.load(first)
    assert same(saved, loaded)
    loaded.save(second)
    assert first.read_bytes() == second.read_bytes()
    saved.save(first)  # overwrites, and leaves nothing beside
    assert sorted(path.name for path in first.parent.iterdir()) == ["first.npz", "second.npz"]
    assert first.stat().st_mode & 0o400


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "kept.npz"
    make_promp().save(path)
    before = path.read_bytes()

    def full(descriptor):
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="no space"):
        ProMP.fit_weights(np.zeros((1, 1, 10))).save(path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["kept.npz"]


@given(st.data())
@settings(deadline=None, max_examples=200)
def test_no_damage_goes_unseen(stored, data):
    """One changed byte or a cut: refused, naming the file, or (unused zip fields) the same ProMP."""
    content, path = stored
    if data.draw(st.booleans()):
        damaged = content[: data.draw(st.integers(0, len(content) - 1))]
    else:
        position = data.draw(st.integers(0, len(content) - 1))
        change = data.draw(st.integers(1, 255))
        damaged = content[:position] + bytes([content[position] ^ change]) + content[position + 1 :]
    path.write_bytes(damaged)
    try:
        loaded = ProMP.load(path)
    except StorageError as error:
        refusal = str(error)
    else:
        assert same(loaded, make_promp())
        return
    assert str(path) in refusal


def rewrite(path, **changes):
    """Write the file anew by numpy alone (so the zip is sound) with some arrays changed; None removes one."""
    with np.load(path) as archive:
        arrays = {**{name: archive[name] for name in archive.files}, **changes}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mean": np.ones((2, 4))}, "does not match its checksum"),
        ({"bandwidth": np.array(0.31)}, "does not match its checksum"),
        ({"version": np.array(2)}, "expected format version 1, got 2"),
        ({"version": None}, "expected format version 1, got None"),
        ({"format": np.array("other")}, "expected a file of format"),
        ({"covariance": None}, "expected the arrays"),
        ({"extra": np.ones(1)}, "expected the arrays"),
        ({"mean": np.array([{"a": 1}], dtype=object)}, "corrupt or truncated one"),  # a pickle inside
    ],
)
def test_altered_content_is_refused(tmp_path, changes, message):
    path = tmp_path / "altered.npz"
    make_promp().save(path)
    rewrite(path, **changes)
    with pytest.raises(StorageError, match=message) as caught:
        ProMP.load(path)
    assert str(path) in str(caught.value)


def test_sound_file_of_something_that_is_no_promp_is_refused(tmp_path):
    path = tmp_path / "other.npz"
    arrays = {
        "mean": np.full((2, 4), np.nan),
        "covariance": np.eye(8),
        "centres": np.linspace(0, 1, 4),
        "bandwidth": np.array(0.3),
    }
    save_arrays(path, arrays)
    with pytest.raises(StorageError, match="other.npz: expected a ProMP: mean: expected finite"):
        ProMP.load(path)
    np.save(tmp_path / "array.npy", np.ones(3))
    with pytest.raises(StorageError, match="array.npy"):
        ProMP.load(tmp_path / "array.npy")
    with pytest.raises(FileNotFoundError, match="absent.npz"):
        ProMP.load(tmp_path / "absent.npz")


def test_checksum_tells_names_types_and_shapes_apart():
    zeros = np.zeros((2, 3))
    variants = [{"a": zeros}, {"b": zeros}, {"a": zeros.T}, {"a": zeros.astype(np.int64)}, {"a": zeros + 1}]
    assert len({checksum(variant) for variant in variants}) == len(variants)
