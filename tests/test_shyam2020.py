"""shyam2020 reproduced: tables as compiled, claims by hand, what is measured, and a small run for real."""

from math import radians

import mujoco
import numpy as np
import pytest
from page_reader import check_self_contained, check_study

from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.problem import ReachPlan
from reproduce.__main__ import main
from reproduce.claims import Rule
from reproduce.page.blocks import Page, Picture, Prose, Section
from reproduce.page.writing import to_html, to_markdown, write_docs
from reproduce.shyam2020 import methods, steps
from reproduce.shyam2020.cases import MOST, GoalCase, context, goal, limits
from reproduce.shyam2020.measures import course, figures
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.page.claims import BEYOND, CLAIMS
from reproduce.shyam2020.page.model import HOME, TABLE_I, TABLE_II, compiled
from reproduce.shyam2020.sampling import draw_samples, prior, sample_figures
from reproduce.shyam2020.steps import (
    ROOM,
    SPHERE_RADIUS,
    literal_figures,
    sphere_in_the_path,
    via_point_figures,
)
from space_envs.dynamics.rotations import angle_between
from space_envs.errors import RenderingError

# Tables


def test_tables_as_compiled_are_the_printed_ones():
    found = compiled()
    np.testing.assert_allclose(found.frames, TABLE_I, atol=1e-12)
    np.testing.assert_allclose(found.bodies, TABLE_II, rtol=1e-12)
    np.testing.assert_array_equal(found.home, HOME)
    assert found.products < 1e-9
    # Forward kinematics by hand, from the printed table alone.
    pose = np.eye(4)
    for (alpha, a, d), theta in zip(TABLE_I, HOME, strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        link = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        pose = pose @ np.array(link)
    np.testing.assert_allclose(found.end_effector, pose[:3, 3], atol=1e-12)


# Claims


def made_figures(**changes: float) -> dict:
    names = "position_error rotation_error end_rate peak_rate peak_acceleration peak_torque shift".split()
    return (
        dict.fromkeys(names, 1e-6)
        | {"cost": 1.0, "end_attitude": 0.1, "peak_attitude": 0.1, "duration": 10.0}
        | changes
    )


def made(**changes) -> dict:
    cost = np.linspace(0.9, 2.0, 100)
    record = {
        "index": 0,
        "methods": {key: made_figures() for key in METHODS},
        "once": {"cost": 1.0},
        "samples": {
            "cost": cost.tolist(),
            "end_attitude": np.linspace(0.1, 0.2, 100).tolist(),
            "within": 100,
            "position_error": 0.01,
            "rotation_error": 0.01,
            "rank_correlation": 1.0,
        },
        "via_point": {"via_point": 1e-9},
        "literal": {"position_error": 0.3, "rotation_error": 0.1},
        "locked": {"still": 7, "of": 7, "starts": 25},
        "encoding": {"error": 0.005, "numbers": 1414, "weights": 70},
        "sphere": {"clear": 3, "usable": 2, "cost": 1.0, "optimal": {"cost": 1.0, "gap": 0.0}},
        "timing": dict.fromkeys(METHODS, 1.0),
    }
    methods = {key: changes.pop(key) for key in list(changes) if key in METHODS}
    record["methods"] |= methods
    return record | changes


LINK_RADIUS = 0.08  # m
FAILED = {"cause": "infeasible", "reason": "none within the limits"}


def answers(rules: tuple[Rule, ...], record: dict) -> dict[str, bool | None]:
    return {each.key: None if each.test is None else each.test(record) for each in rules}


def test_claims_about_costs_by_hand():
    found = answers(
        CLAIMS + BEYOND,
        made(
            minimum_jerk=made_figures(cost=0.99),
            mpc=made_figures(cost=1.2),
            promp_mean=made_figures(cost=1.2, end_attitude=0.105),
            ocp=made_figures(cost=0.5),
            promp_optimal=made_figures(cost=0.58),
            promp_optimal_kept=made_figures(cost=1.1, end_attitude=1e-5),
        ),
    )
    assert found["sampling_100"] is True and found["sampling_20"] is True  # 1.0 and 0.9 of 1.2
    assert found["against_minimum_jerk"] is False and found["against_demonstrator"] is True
    assert found["minimum"] is False and found["attitude"] is False and found["attitude_any"] is False
    assert found["attitude_optimum"] is False
    assert found["reference"] is True and found["weights_hold_it"] is False  # 1.16
    assert found["kept"] is True and found["kept_costs_less"] is False
    assert found["initial_guess"] is None and found["first"] is None
    assert answers(BEYOND, made(ocp=made_figures(cost=1.01)))["reference"] is False
    assert answers(BEYOND, made(promp_optimal_kept=made_figures(end_attitude=0.01)))["kept"] is False
    assert answers(CLAIMS, made(promp=made_figures(end_attitude=radians(0.04))))["attitude_optimum"] is True


def test_claims_about_samples_by_hand():
    found = answers(CLAIMS, made())
    assert found["cost_measures"] is True and found["several"] is True and found["unseen"] is True
    assert found["literal"] is False and found["compact"] is True and found["via_point"] is True
    record = made()
    record["samples"]["end_attitude"] = record["samples"]["end_attitude"][::-1]
    assert answers(CLAIMS, record)["cost_measures"] is False
    record["samples"]["position_error"] = 0.051
    assert answers(CLAIMS, record)["several"] is False
    assert answers(CLAIMS, made(promp=made_figures(position_error=1.1e-3)))["unseen"] is False
    assert answers(CLAIMS, made(promp=FAILED))["unseen"] is False
    assert answers(CLAIMS, made(literal={"position_error": 0.04, "rotation_error": 0.08}))["literal"] is True
    assert found["special_cases"] is True
    never = made_figures(peak_attitude=1e-5)
    assert answers(CLAIMS, made(promp_reactionless=never))["special_cases"] is False
    assert answers(CLAIMS, made(promp_reactionless=never | {"position_error": 2e-3}))["special_cases"] is True
    assert answers(CLAIMS, made(promp_reactionless=FAILED))["special_cases"] is True
    assert answers(CLAIMS, made(locked={"still": 6, "of": 7, "starts": 25}))["failure"] is False


def test_claims_about_spheres_times_and_minima_by_hand():
    blocked = {"clear": 1, "usable": 0, "cost": None, "optimal": FAILED}
    found = answers(CLAIMS + BEYOND, made(sphere=blocked))
    assert found["obstacle_free"] is False and found["avoids"] is False
    touching = {"clear": 1, "usable": 1, "cost": 1.0, "optimal": {"cost": 1.0, "gap": -2e-4}}
    assert answers(BEYOND, made(sphere=touching))["avoids"] is False
    none = answers(CLAIMS + BEYOND, made(sphere=None))
    assert none["obstacle_free"] is None and none["avoids"] is None
    times = dict.fromkeys(METHODS, 1.0) | {"promp": 0.05, "promp_optimal": 0.02, "promp_optimal_kept": 0.2}
    found = answers(CLAIMS + BEYOND, made(timing=times))
    assert found["efficient"] is True and found["expensive"] is False
    assert found["optimum_faster"] is True and found["kept_real_time"] is False
    assert answers(CLAIMS, made(once={"cost": 1.02}))["local_minima"] is True
    assert answers(CLAIMS, made(once={"cost": 1.001}))["local_minima"] is False
    assert answers(CLAIMS, made(once=FAILED))["local_minima"] is True


def test_methods_without_a_plan_are_left_out():
    empty = dict.fromkeys(("samples", "via_point", "encoding", "sphere"))
    record = made(**dict.fromkeys(METHODS, FAILED), **empty)
    found = answers(CLAIMS + BEYOND, record)
    assert [key for key, value in found.items() if value is not None] == [
        "unseen",
        "literal",
        "special_cases",
        "failure",
    ]
    for each in CLAIMS + BEYOND:
        assert each.measured(record) and each.measured(made())


# Measures


def still(case: GoalCase, steps: int = 11) -> JointMotion:
    return JointMotion(np.tile(case.start, (steps, 1)), np.zeros((steps, 7)), 10.0 / (steps - 1))


def test_goals_are_the_frozen_ones_and_the_own_one_is_none_of_them():
    own, first, second = goal(-1), goal(0), goal(1)
    assert np.linalg.norm(first.position - second.position) > 0.1
    assert np.linalg.norm(own.position - first.position) > 0.1
    np.testing.assert_array_equal(goal(1).position, second.position)
    layout = context().layout
    np.testing.assert_array_equal(layout.read(own.observation, "goal_position")[0], own.position)
    assert (limits().rate == 0.3).all()
    assert (limits().torque == 60.0).all()


def test_a_motion_is_measured_as_mujoco_simulates_it():
    """Course of a minimum jerk, against MuJoCo with the same joint motion imposed by computed torques."""
    case = goal(-1)
    motion = METHODS["minimum_jerk"].plan(case, 0)
    assert isinstance(motion, JointMotion)
    done = course(motion)
    found = figures(done, case)
    assert found["position_error"] < 1e-4 and found["rotation_error"] < 1e-4 and found["end_rate"] < 1e-9
    model = context().model
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    model_step, mass = 0.02, np.empty((model.nv, model.nv))
    assert model.opt.timestep == pytest.approx(model_step)
    cost = 0.0
    for step in range(500):
        k = 2 * step
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        error, slip = done.joints[k] - data.qpos[7:], done.rate[k] - data.qvel[6:]
        wanted = done.acceleration[min(k + 1, 1000)] + 25.0 * error + 10.0 * slip
        base = -np.linalg.solve(mass[:6, :6], data.qfrc_bias[:6] + mass[:6, 6:] @ wanted)
        data.ctrl[:] = mass[6:, :6] @ base + mass[6:, 6:] @ wanted + data.qfrc_bias[6:]
        cost += model_step * float(data.qvel[:6] @ data.qvel[:6])
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.qpos[:3], done.base[-1], atol=2e-4)
    assert angle_between(data.qpos[3:7], done.attitude[-1]) < 1e-4
    assert cost == pytest.approx(done.cost, rel=1e-3)
    assert (np.abs(data.ctrl) < limits().torque).all() and found["peak_torque"] < 20.0


def test_sampled_and_exact_motions_are_measured_alike():
    case = goal(2)
    motion = METHODS["minimum_jerk"].plan(case, 0)
    assert isinstance(motion, JointMotion)
    time = motion.dt * np.arange(len(motion.position))
    acceleration = np.gradient(motion.velocity, motion.dt, axis=0, edge_order=2)
    nodes = ReachPlan("test", time, motion.position, motion.velocity, acceleration, cost=0.0)
    one, two = figures(course(motion), case), figures(course(nodes), case)
    for name in ("cost", "end_attitude", "peak_attitude", "shift"):
        assert one[name] == pytest.approx(two[name], rel=1e-4)
    rest = figures(course(still(case)), case)
    assert rest["cost"] == 0.0 and rest["end_attitude"] == 0.0 and rest["position_error"] > 0.1


def test_samples_start_and_end_alike_and_are_seeded():
    case = goal(0)
    drawn, again, other = draw_samples(case, 3, 12), draw_samples(case, 3, 12), draw_samples(case, 4, 12)
    assert drawn and again and other
    np.testing.assert_array_equal(drawn.weights, again.weights)
    assert np.abs(drawn.weights - other.weights).max() > 1e-3
    np.testing.assert_allclose(drawn.motion.position[:, 0], np.tile(case.start, (12, 1)), atol=1e-6)
    np.testing.assert_allclose(drawn.motion.position[:, -1], np.tile(drawn.goal, (12, 1)), atol=1e-6)
    np.testing.assert_allclose(drawn.motion.velocity[:, [0, -1]], 0.0, atol=1e-6)
    # Each is measured as any motion is.
    motion = JointMotion(drawn.motion.position[5], drawn.motion.velocity[5], drawn.motion.dt)
    found = figures(course(motion), case)
    assert drawn.cost[5] == pytest.approx(found["cost"], rel=1e-3)
    assert drawn.position_error[5] == pytest.approx(found["position_error"], abs=2e-4)
    assert drawn.end_attitude[5] == pytest.approx(found["end_attitude"], rel=1e-3)
    summary = sample_figures(drawn)
    assert len(summary["cost"]) == 12 and summary["within"] <= 12
    assert summary["position_error"] == drawn.position_error.max()


def test_the_mean_meets_the_goal_and_the_literal_reading_does_not():
    case = goal(0)
    found = METHODS["promp_mean"].plan(case, 0)
    assert isinstance(found, JointMotion)
    assert figures(course(found), case)["position_error"] < 1e-3
    assert literal_figures(case)["position_error"] > 0.1
    drawn = draw_samples(case, 0, 2)
    assert drawn and via_point_figures(case, drawn.goal)["via_point"] < 1e-6


def test_the_sphere_is_in_the_path_and_clear_of_the_ends():
    case = goal(0)
    drawn = draw_samples(case, 0, 100)
    assert drawn
    mean = course(prior().motion(drawn.weights.mean(axis=0)))
    sphere = sphere_in_the_path(mean)
    assert sphere is not None and sphere.shape == (1, 4) and sphere[0, 3] == SPHERE_RADIUS
    # Distances by dense points along the links, joint by joint from MuJoCo.
    data = mujoco.MjData(context().model)
    gaps = []
    for k in (0, *range(0, 1001, 50), 1000):
        data.qpos[:] = np.concatenate([mean.base[k], mean.attitude[k], mean.joints[k]])
        mujoco.mj_kinematics(context().model, data)
        ends = np.array([*(data.body(f"link{i}").xpos for i in range(1, 8)), data.site("end_effector").xpos])
        share = np.linspace(0.0, 1.0, 400)[:, None, None]
        points = ends[:-1] + share * np.diff(ends, axis=0)
        gaps.append(np.linalg.norm(points - sphere[0, :3], axis=-1).min() - SPHERE_RADIUS - LINK_RADIUS)
    assert min(gaps[0], gaps[-1]) >= ROOM - 1e-3
    assert min(gaps) < -0.5 * SPHERE_RADIUS


def test_locked_joints_stay_where_they_are(monkeypatch):
    """Counting is over single joints, each held by its limits; a joint counts if any start leads there."""
    seen, rows = [], []

    def search(arm, position, quaternion, motion, base, turn, start, bounds):
        seen.append(bounds)
        rows.append(len(start))
        assert (start >= bounds[:, 0]).all() and (start <= bounds[:, 1]).all()
        joint = int(np.flatnonzero(bounds[:, 0] == bounds[:, 1])[0])
        return type(
            "Found", (), {"converged": np.arange(len(start)) == (0 if joint < 3 else 8 * joint - 23)}
        )()

    monkeypatch.setattr(steps, "floating_inverse_kinematics", search)
    case = goal(0)
    assert steps.locked_figures(case, 25) == {"still": 6, "of": 7, "starts": 25}
    assert rows == [1] * 3 + [1, 24] * 4
    for bounds in seen:
        held = np.flatnonzero(bounds[:, 0] == bounds[:, 1])
        assert len(held) == 1 and bounds[held[0], 0] == case.start[held[0]]


def test_a_search_from_one_start_gives_up_where_another_reaches_the_goal():
    """What one start does not find is no proof that it cannot be."""
    one, many = (steps.locked_figures(goal(0), starts)["still"] for starts in (1, 25))
    assert one < many


# The page


def test_pictures_stand_on_the_page_and_in_the_documentation(tmp_path):
    picture = Picture("poses", "title", "caption", "two <poses>", b"\xff\xd8\xff\xe0 not quite a picture")
    page = Page(
        "paper",
        "Title",
        ("lead",),
        "",
        (),
        (),
        (Section("One", (picture, Prose(("words",)))),),
        "cmd",
        {},
        {},
    )
    text = to_html(page)
    check_self_contained(text)
    assert "data:image/jpeg;base64,/9j/4C" in text and "two &lt;poses&gt;" in text
    assert "](figures/poses.jpg)" in to_markdown(page, "figures")
    write_docs(page, tmp_path)
    assert (tmp_path / "images" / "paper_poses.jpg").read_bytes() == picture.jpeg


@pytest.fixture
def fast(monkeypatch):
    """Optimal control from one start, and less to time."""
    plan = methods.plan_ocp

    def few(*given, starts: int = 1, **named):
        return plan(*given, starts=1, **named)

    monkeypatch.setattr(methods, "plan_ocp", few)
    monkeypatch.setattr("reproduce.shyam2020.timing.REPEATS", 2)
    monkeypatch.setattr("reproduce.shyam2020.timing.DEMONSTRATIONS", 3)
    monkeypatch.setattr("reproduce.shyam2020.QUICK", 12)
    monkeypatch.setattr("reproduce.shyam2020.feedback.EPISODES", 4)


@pytest.mark.usefixtures("fast")
def test_a_small_run_for_real(tmp_path, capsys, monkeypatch, request):
    def no_picture(*given: object, **named: object) -> None:
        raise RenderingError("no OpenGL here")

    monkeypatch.setattr("space_envs.rendering.Renderer.render", no_picture)
    docs, out = tmp_path / "docs", tmp_path / "out"
    docs.mkdir()
    words = ["shyam2020", "--quick", "--cases", "1", "--jobs", "1", "--output", str(out), "--docs", str(docs)]
    assert main(words) == 0
    text, summary, written = check_study("shyam2020", tmp_path, request)
    assert "A quick run: only 1 of the goals" in text and "no OpenGL here" in text
    assert [case["index"] for case in summary["cases"]] == [0]
    for record in (summary["own"], *summary["cases"]):
        for found in record["methods"].values():
            assert found.get("cause") in (None, *map(str, Cause))
            assert ("cost" in found) != ("cause" in found)
        plans = record["methods"]
        assert plans["ocp"]["cost"] < plans["minimum_jerk"]["cost"] < plans["promp_mean"]["cost"]
        assert plans["promp"]["cost"] < plans["promp_mean"]["cost"]
    names = {path.name for path in (out / "figures").iterdir()}
    assert names >= {f"fig{number}.svg" for number in range(2, 7)}
    assert names >= {"compared.svg", "workspace.svg", "feedback.svg"}
    assert "Table II" in written
    for words in ("workspace that the demonstrations cover", "elastic bands in joint space, ours"):
        assert words in written
    assert "Control from the learned distribution" in written and "promp_feedback" in written
    assert "shyam2020.html" in capsys.readouterr().out


def test_more_cases_than_goals_are_refused_at_once(tmp_path, capsys):
    words = ["shyam2020", "--cases", str(MOST + 1), "--output", str(tmp_path)]
    assert main(words) == 2
    assert f"at most {MOST}" in capsys.readouterr().err


def test_a_policy_that_finds_no_joint_goal_is_a_failure():
    far = GoalCase(0, goal(0).start, np.array([9.0, 9.0, 9.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    found = METHODS["minimum_jerk"].plan(far, 0)
    assert isinstance(found, Failure) and found.cause is Cause.OUT_OF_REACH and "mm" in found.reason
    assert draw_samples(far, 0, 2) is None
