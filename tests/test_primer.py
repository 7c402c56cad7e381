"""The primer's pictures show what its text says, and are those of their command."""

import re

import numpy as np

from docs import primer
from docs.generate import DOCS
from docs.primer_motions import (
    ARM,
    DURATION,
    LINE,
    PlanarMotion,
    loops,
    planar_robot,
    reactionless_swing,
    straight_line,
    swing,
)

PAGE = (DOCS / "primer.md").read_text(encoding="utf-8")


def center_of_mass(motion: PlanarMotion) -> np.ndarray:
    """Common centre of mass (T, 2) of a motion, inertial frame, m."""
    robot = planar_robot()
    links = robot.kinematics(motion.q).com[..., :2]
    cos, sin = np.cos(motion.angle)[:, None], np.sin(motion.angle)[:, None]
    x, y = links[..., 0], links[..., 1]
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1) + motion.position[:, None, :2]
    moments = robot.mass[0] * motion.position[:, :2] + np.einsum("i,tik->tk", robot.mass[1:], turned)
    return moments / robot.mass.sum()


def test_a_free_base_moves_about_a_common_centre_of_mass_at_rest():
    held, free = swing(base_held=True), swing()
    assert held.rotation == 0.0 and abs(free.rotation) > 10.0
    np.testing.assert_array_equal(held.q, free.q)
    center = center_of_mass(free)
    np.testing.assert_allclose(center, np.broadcast_to(center[0], center.shape), atol=1e-4)
    assert np.ptp(center_of_mass(held), axis=0).max() > 0.05
    assert np.linalg.norm(held.points[-1, 0, -1] - free.points[-1, 0, -1]) > 0.3


def test_duration_changes_the_cost_and_not_the_attitude():
    fast, slow = swing(DURATION), swing(2.0 * DURATION)
    np.testing.assert_allclose(fast.rotation, slow.rotation, rtol=1e-6)
    np.testing.assert_allclose(fast.cost, 2.0 * slow.cost, rtol=1e-6)


def test_only_the_generalized_jacobian_follows_the_line():
    for generalized, holds in ((True, lambda error: error < 1e-4), (False, lambda error: error > 0.05)):
        path = straight_line(generalized).points[:, 0, -1]
        across = np.abs((path - path[0]) @ np.array([-LINE[1], LINE[0]]) / np.linalg.norm(LINE)).max()
        assert holds(max(across, np.linalg.norm(path[-1] - path[0] - LINE)))


def test_projected_rates_leave_the_base_at_rest_by_moving_the_other_arm():
    motion = reactionless_swing()
    assert np.degrees(np.abs(motion.angle)).max() < 1e-4
    assert np.ptp(motion.q[:, ARM.stop :], axis=0).max() > 0.1


def test_each_closed_loop_rotates_the_base_by_the_same_angle():
    motion = loops(3)
    np.testing.assert_allclose(motion.q[-1], motion.q[0], atol=1e-9)
    assert abs(motion.rotation) > 3.0
    np.testing.assert_allclose(motion.rotation, 3.0 * loops(1).rotation, rtol=1e-3)


def texts(svg: str) -> list[str]:
    return re.findall(r"<text[^>]*>(.*?)</text>", svg, re.S)


def test_pictures_of_the_page_are_those_of_their_command(tmp_path, capsys):
    assert primer.main(["--output", str(tmp_path)]) == 0
    assert {f"primer_{name}" for name in re.findall(r"images/primer_(\w+)\.svg", PAGE)} == set(
        primer.PICTURES
    )
    for name in primer.PICTURES:
        drawn = (tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        shipped = (DOCS / "images" / f"{name}.svg").read_text(encoding="utf-8")
        assert texts(drawn) == texts(shipped) != []
