"""Replays: which episodes, the surfaces that are drawn, and what reaches the page."""

import base64
import json
import re
import zlib
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from synthetic_results import HOSTILE, PlayedEpisodes, changed, make_played, make_record, rows_of

from space_envs.errors import ConfigurationError
from space_envs.evaluation.replay.packing import (
    frames,
    json_text,
    packed,
    quantised,
    replay_values,
    scene_values,
    size_of,
)
from space_envs.evaluation.replay.replay import Replay, make_replays
from space_envs.evaluation.replay.scenes import make_motion, make_scene
from space_envs.evaluation.replay.solids import Solid, box, capsule, cylinder, ellipsoid, geom_solid
from space_envs.evaluation.replay.videos import write_videos
from space_envs.evaluation.report.drawing.look import make_looks
from space_envs.evaluation.report.page.replays import REPLAY_CHARACTERS, page_replays
from space_envs.registration import ENTRIES, make_task
from space_envs.system.opengl import missing_gl


@pytest.fixture(scope="module")
def played() -> PlayedEpisodes:
    return make_played("minimum_jerk", episodes=3)


@pytest.fixture(scope="module")
def replays(played: PlayedEpisodes) -> tuple[Replay, ...]:
    return make_replays(played.task, played.episodes, played.records)


def volume(solid: Solid) -> float:
    """By the divergence theorem, right only where the triangles close and face outwards."""
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def is_closed(solid: Solid) -> bool:
    """Every edge is passed once in each direction, taking vertices in one place for one."""
    _, place = np.unique(solid.vertices.round(9), axis=0, return_inverse=True)
    edges = place.reshape(-1)[solid.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)]
    passed = {tuple(edge) for edge in edges.tolist()}
    return len(passed) == len(edges) and all((b, a) in passed for a, b in passed)


# Which episodes


def test_best_median_and_worst_by_hand() -> None:
    played = make_played("hold", episodes=5)
    ends = [(True, 3.0), (False, 0.1), (True, 1.0), (True, 2.0), (False, 0.0)]
    records = [
        changed(
            record,
            captured=captured,
            outcome="captured" if captured else "timeout",
            cause=None if captured else "timeout",
            time_to_capture=1.0 if captured else None,
            time_to_envelope=0.0 if captured else None,
            final_attitude=attitude,
        )
        for record, (captured, attitude) in zip(played.records, ends, strict=True)
    ]
    chosen = make_replays(played.task, played.episodes, records)
    # In order: 2, 3, 0, then the failures 4 and 1; a failure is worse than any capture.
    assert [(one.label, one.episode) for one in chosen] == [("best", 2), ("median", 0), ("worst", 1)]
    tied = [changed(record, final_attitude=0.0, attitude_cost=0.0) for record in records]
    assert make_replays(played.task, played.episodes, tied)[0].episode == 0


def test_fewer_episodes_give_fewer_replays() -> None:
    for count, labels in ((1, ["best"]), (2, ["best", "worst"])):
        played = make_played("hold", episodes=count)
        made = make_replays(played.task, played.episodes, played.records)
        assert [one.label for one in made] == labels
    with pytest.raises(ConfigurationError, match="not of the same"):
        make_replays(played.task, played.episodes, played.records[::-1])


def test_a_replay_ends_with_its_episode(replays: tuple[Replay, ...]) -> None:
    for one in replays:
        assert one.outcome == "captured" and 10 < len(one.time) < 200
        assert len(one.time) == len(one.attitude) == len(one.distance) == len(one.scene)
        assert one.time[1] == pytest.approx(0.1)
        assert one.distance[-1] < 0.05 < one.distance[0]
        assert len(one.goals.joint_position) == 1


# Surfaces


@pytest.mark.parametrize(
    ("solid", "exact"),
    [
        (box(np.array([0.1, 0.2, 0.3])), 8 * 0.1 * 0.2 * 0.3),
        (cylinder(0.2, 0.5), np.pi * 0.2**2),
        (capsule(0.2, 0.5), np.pi * 0.2**2 + 4 / 3 * np.pi * 0.2**3),
        (ellipsoid(np.array([0.1, 0.2, 0.3])), 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
        (cylinder(0.01, 0.5), np.pi * 0.01**2),
    ],
)
def test_surfaces_are_closed_and_face_outwards(solid: Solid, exact: float) -> None:
    assert is_closed(solid)
    # What is round is cut off by its facets: at most a tenth with eight sides.
    assert 0.89 * exact < volume(solid) < 1.0001 * exact
    np.testing.assert_allclose(np.linalg.norm(solid.normals, axis=1), 1)
    a, b, c = (solid.vertices[solid.triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    for k in range(3):
        assert ((faces * solid.normals[solid.triangles[:, k]]).sum(axis=1) > 0).all()


def test_meshes_are_those_of_the_model_and_planes_are_refused() -> None:
    corners = "0 0 0  1 0 0  0 1 0  0 0 1"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset><mesh name='m' vertex='{corners}'/></asset><worldbody>"
        "<geom type='mesh' mesh='m'/><geom type='plane' size='1 1 1'/></worldbody></mujoco>"
    )
    solid = geom_solid(model, 0)
    assert is_closed(solid) and volume(solid) == pytest.approx(1 / 6, rel=1e-5)
    with pytest.raises(ConfigurationError, match="PLANE cannot be replayed"):
        geom_solid(model, 1)


@pytest.mark.parametrize("env_id", ENTRIES)
def test_scene_shows_what_mujoco_shows(env_id: str) -> None:
    """Seen from MuJoCo's own rays: a ray to the middle of a triangle meets the model at that triangle."""
    task = make_task(env_id, {})
    model, scene = task.render_model, make_scene(task.render_model)
    assert scene.vertices.dtype == float and len(scene.triangles) < 25_000
    assert scene.body.max() == len(scene.bodies) - 1 and 0 not in scene.bodies
    assert [name for name, _, _ in scene.end_effectors] == [
        n for n in _sites(model) if n.startswith("end_effector")
    ]
    assert scene.planet is not None and scene.planet[3] == pytest.approx(305, rel=0.01)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    middles = scene.vertices[scene.triangles].mean(axis=1)
    kept = np.random.default_rng(0).choice(scene.opaque, 200, replace=False)
    eye, hits, geom = scene.eye, [], np.zeros(1, dtype=np.int32)
    for triangle in kept:
        body = scene.bodies[scene.body[scene.triangles[triangle, 0]]]
        place = data.xmat[body].reshape(3, 3) @ middles[triangle] + data.xpos[body]
        way, group = place - eye, np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
        far = mujoco.mj_ray(model, data, eye, way, group, 1, -1, geom)
        hits.append(abs(far - 1) * np.linalg.norm(way) < 0.02)
        assert far < 1 + 0.05 / np.linalg.norm(way)  # something is there, or before it
    # About half of the surface faces away or is hidden.
    assert np.mean(hits) > 0.2


def _sites(model: mujoco.MjModel) -> list[str]:
    return [model.site(number).name for number in range(model.nsite)]


@pytest.mark.parametrize("env_id", ["SpaceCapture/SingleArmCluttered-v0", "SpaceCapture/DualArmPlanar-v0"])
def test_goals_that_come_in_sizes_are_drawn_in_their_sizes(env_id: str) -> None:
    played = make_played("hold", episodes=3, env_id=env_id)
    scene = make_scene(played.task.render_model)
    for one in make_replays(played.task, played.episodes, played.records):
        size = make_motion(one, scene).size
        names = [played.task.render_model.body(body).name for body in scene.bodies]
        if "obstacle1" in names:
            model, first = played.task.render_model, names.index("obstacle1")
            drawn = size[first : first + 3] * model.site("obstacle1_surface").pos[0]
            np.testing.assert_allclose(drawn, one.goals.obstacle_radius[0])
        else:
            grapple = np.linalg.norm(played.task.render_model.site("grapple1").pos)
            assert size[names.index("target")] * grapple == pytest.approx(one.goals.half_width[0])
        assert np.count_nonzero(size != 1) <= 3


# What reaches the page


def unpack(text: str, kind: str, shape: tuple[int, ...], start: int) -> NDArray[np.generic]:
    content = zlib.decompress(base64.b64decode(text))
    count = int(np.prod(shape))
    return np.frombuffer(content, dtype=kind, count=count, offset=start).reshape(shape)


def test_motion_comes_back_from_the_page(replays: tuple[Replay, ...]) -> None:
    one = replays[0]
    scene = make_scene(one.task.render_model)
    motion = make_motion(one, scene)
    values = json.loads(json_text(replay_values(one, motion)))
    shape = (len(one.time), len(scene.bodies))
    steps = (
        unpack(values["data"], "<i2", (*shape, 3), 0),
        unpack(values["data"], "<i2", (*shape, 4), 6 * shape[0] * shape[1]),
    )
    position, turn = (np.cumsum(each, axis=0, dtype=np.int16).astype(float) for each in steps)
    np.testing.assert_allclose(values["unit"] * position, motion.position, atol=0.51 * values["unit"])
    assert values["unit"] < 1e-3  # m
    np.testing.assert_allclose(turn / 32767, motion.quaternion, atol=2e-5)
    np.testing.assert_allclose(values["attitude"], one.attitude, rtol=1e-4)
    # The end-effector ends at the grapple that it took: what is drawn is the recorded state.
    _, body, place = scene.end_effectors[0]
    turn_end, end = np.empty(9), motion.quaternion[-1, body].copy()
    mujoco.mju_quat2Mat(turn_end, end)
    tip = motion.position[-1, body] + turn_end.reshape(3, 3) @ place
    assert np.linalg.norm(tip - one.goals.position[0]) == pytest.approx(one.distance[-1], abs=1e-6)


def test_scene_comes_back_from_the_page(replays: tuple[Replay, ...]) -> None:
    scene = make_scene(replays[0].task.render_model)
    values = scene_values(scene)
    start = 12 * len(scene.triangles)
    np.testing.assert_array_equal(unpack(values["data"], "<u4", scene.triangles.shape, 0), scene.triangles)
    places = unpack(values["data"], "<i2", scene.vertices.shape, start).astype(float)
    np.testing.assert_allclose(values["unit"] * places, scene.vertices, atol=1e-4)
    start += 14 * len(scene.vertices)
    np.testing.assert_array_equal(unpack(values["data"], "u1", scene.body.shape, start), scene.body)
    assert len(values["data"]) < 250_000


def test_quantised_and_frames() -> None:
    whole, unit = quantised(np.array([-2.0, 0.0, 1.0]))
    assert whole.tolist() == [-32767, 0, 16384] and unit == 2 / 32767
    assert quantised(np.zeros(3))[0].tolist() == [0, 0, 0]
    assert frames(7, 3).tolist() == [0, 3, 6, 7] and frames(6, 3).tolist() == [0, 3, 6]
    assert zlib.decompress(base64.b64decode(packed([np.array([1, 2], dtype=np.uint16)]))) == b"\1\0\2\0"


def test_json_text_ends_no_script() -> None:
    value = {"name": "</script><!--\u2028&" + HOSTILE}
    text = json_text(value)
    assert not re.search(r"[<>&\u2028]", text) and json.loads(text) == value
    with pytest.raises(ValueError):
        json_text(float("nan"))


def test_many_replays_lose_frames_and_fit(
    played: PlayedEpisodes, replays: tuple[Replay, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = rows_of(played.records)
    task, entry = rows[0].task, rows[0].entry

    def shown() -> tuple[int, list[list[float]], int]:
        """Stride, times of the frames of each replay, and size of what the page holds of them."""
        found = page_replays([(task, rows)], {entry: replays}, make_looks([entry.policy]))[task]
        assert found is not None
        episodes = json.loads(found["json"])["policies"][0]["episodes"]
        return found["stride"], [one["time"] for one in episodes], sum(map(size_of, episodes))

    stride, times, size = shown()
    assert stride == 1 and [len(each) for each in times] == [len(one.time) for one in replays]
    assert size < REPLAY_CHARACTERS / 80
    monkeypatch.setattr("space_envs.evaluation.report.page.replays.REPLAY_CHARACTERS", size // 2)
    stride, fewer, smaller = shown()
    assert stride > 1 and smaller <= size // 2
    assert [each[-1] for each in fewer] == [each[-1] for each in times]


def test_video_of_a_replay(replays: tuple[Replay, ...], tmp_path: Path) -> None:
    import imageio.v3 as iio

    short = replace(replays[0], scene=replays[0].scene[::12])
    entry, path = make_record().entry, tmp_path / "best.mp4"
    written, note = write_videos({entry: (short, path)})
    if missing_gl() is not None:
        assert written == {} and note.startswith("There are no videos: ") and not list(tmp_path.iterdir())
        return
    assert (written, note) == ({entry: path}, "")
    shown = iio.imread(path)
    assert len(shown) == len(short.scene) and shown.shape[1:] == (720, 960, 3)
    assert np.abs(shown[0].astype(int) - shown[-1]).max() > 60
