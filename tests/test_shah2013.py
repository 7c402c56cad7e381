"""shah2013 reproduced: its cases, its claims by hand, what is measured, and a small run for real."""

from dataclasses import replace

import numpy as np
import pytest
from page_reader import check_study

from agents.planners.common.plans import Cause
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.problem import CapturePlan
from agents.planners.dual_arm.tracking import Tracking
from reproduce.__main__ import main
from reproduce.claims import Rule
from reproduce.compare import ratio
from reproduce.shah2013.cases import CANONICAL, Sampler, planar_robot, reach_used
from reproduce.shah2013.claims import BEYOND, CLAIMS, nonsingular
from reproduce.shah2013.measures import curves, free_direction, polynomial, record, task_rows
from reproduce.shah2013.methods import METHODS

HOSTILE = '<script>alert(1)</script> & $x_1$ | `a` [b](http://c) "q"'


# Cases


def test_drawn_cases_are_seeded_distinct_and_in_reach():
    sampler, robot = Sampler(), planar_robot()
    drawn = [sampler.draw(3, index) for index in range(60)]
    assert drawn == [sampler.draw(3, index) for index in range(60)]
    assert sampler.draw(4, 0) != drawn[0]
    assert len({case.start for case in drawn}) == len({case.spin for case in drawn}) == 60
    starts = np.array([case.start for case in drawn])
    assert (np.abs(starts - CANONICAL.start) <= sampler.joint).all()
    assert np.abs(starts - CANONICAL.start).max() > 0.9 * sampler.joint
    assert (np.abs(starts) <= [3.1, 2.7, 2.7, 3.1, 2.7, 2.7]).all()
    assert max(reach_used(robot, case).max() for case in drawn) <= sampler.reach
    assert min(case.spin for case in drawn) < -0.05 and max(case.spin for case in drawn) > 0.05


def test_canonical_case_meets_the_papers_ends():
    capture = CANONICAL.capture
    np.testing.assert_allclose(capture.position, [[2.0, 0.7, 0.0], [2.0, 1.3, 0.0]], atol=1e-15)
    np.testing.assert_allclose(capture.velocity, [[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]], atol=1e-15)


def test_grapple_points_move_with_the_target():
    case, step = Sampler().draw(1, 5), 1e-6
    before, after = (
        replace(case, angle=case.angle + sign * step * case.spin).capture.position for sign in (-1, 1)
    )
    np.testing.assert_allclose(case.capture.velocity, (after - before) / (2 * step), atol=1e-9)


# Claims


def figures(**changes: float) -> dict:
    names = (
        "energy energy_check start_energy work peak_power base_rate path end_position end_velocity "
        "spin_error jolt jolt_time jolt_ratio arm1_jolt arm1_jolt_time arm2_jolt arm2_jolt_time "
        "zeta_jolt zeta_jolt_time zeta_jolt_ratio gradient least_singular "
        "tracked_base_rate tracked_momentum lead"
    ).split()
    return dict.fromkeys(names, 1e-12) | {"energy": 1.0, "peak_power": 1.0, "jolt": 1.0} | changes


def made(**methods: dict) -> dict:
    found = {key: figures() for key in METHODS} | methods
    return {"index": -1, "case": {"duration": 20.0}, "methods": found}


FAILED = {"cause": "singular", "reason": "singular at t = 3 s"}


def answers(rules: tuple[Rule, ...], record: dict) -> dict[str, bool | None]:
    return {each.key: None if each.test is None else each.test(record) for each in rules}


def test_claims_about_energy_and_power_by_hand():
    found = answers(
        CLAIMS,
        made(
            zeta_zero=figures(energy=2.0, peak_power=3.0, gradient=0.4),
            local=figures(energy=2.5, peak_power=2.9, lead=-0.1, zeta_jolt_ratio=4.5, zeta_jolt_time=15.1),
            ocp=figures(energy=1.9, peak_power=2.5, jolt=1.1),
            free=figures(energy=1.0),
        ),
    )
    assert found["local_energy"] is True and found["local_power"] is False
    assert found["zero_not_optimal"] is True and found["not_total"] is True
    assert found["ocp_energy"] is False  # 5 % is not much
    assert found["ocp_power"] is True
    assert found["jump"] is True and found["jump_cost"] is True
    assert found["smooth"] is False
    assert found["minimum"] is False
    assert found["global"] is None


def test_claims_about_a_jump_by_hand():
    def jump(**changes: float) -> dict:
        values = {"energy": 2.0, "zeta_jolt_ratio": 9.0, "zeta_jolt_time": 18.0} | changes
        return answers(CLAIMS, made(local=figures(**values)))

    assert jump()["jump"] is True
    assert jump(zeta_jolt_time=14.9)["jump"] is False
    assert jump(zeta_jolt_ratio=3.9)["jump"] is False
    assert jump(lead=0.1)["jump_cost"] is False
    assert jump(energy=0.9)["jump_cost"] is None
    assert jump(arm1_jolt_time=18.4)["jump_time"] is True
    assert jump(arm1_jolt_time=16.1)["jump_time"] is jump(arm1_jolt_time=18.6)["jump_time"] is False
    elsewhere = made(local=figures(arm1_jolt_time=18.0)) | {"index": 0}
    assert answers(CLAIMS, elsewhere)["jump_time"] is None  # only the canonical case stands for the paper's


def test_arm_1_changes_fastest_at_the_papers_18_s(plans):
    """Known from an independent computation: arm 1's dependent velocity at 18.16 s, arm 2's at 16.085 s."""
    found = record(plans["local"], curves(plans["local"]), CANONICAL)
    assert found["arm1_jolt_time"] == pytest.approx(18.16, abs=0.005)
    assert found["arm2_jolt_time"] == pytest.approx(16.085, abs=0.005)
    assert found["arm1_jolt"] < found["arm2_jolt"] <= found["jolt"]
    (rule,) = [each for each in CLAIMS if each.key == "jump_time"]
    whole = made(local=figures() | found)
    assert rule.test is not None and rule.test(whole) is True
    assert "arm 1 changes fastest at t = 18.16 s" in rule.measured(whole)


def test_methods_without_a_plan_are_left_out():
    record = made(zeta_zero=FAILED, local=FAILED, ocp=FAILED)
    found = answers(CLAIMS + BEYOND, record)
    assert found.pop("independent") is False and found.pop("reaches") is True and found.pop("torque") is True
    assert answers(BEYOND, made())["reaches"] is None
    assert set(found.values()) == {None}
    assert not nonsingular(record) and ratio(record, "energy", "free", "ocp") is None
    for each in CLAIMS + BEYOND:
        assert each.measured(record)
    assert answers(BEYOND, made(free=FAILED))["free"] is False  # a capture that (c) found and (d) did not


# Measures


@pytest.fixture(scope="module")
def plans() -> dict[str, CapturePlan]:
    found = {
        key: plan(planar_robot(), CANONICAL.capture)
        for key, plan in (("zeta_zero", plan_zeta_zero), ("local", plan_local))
    }
    return {key: plan for key, plan in found.items() if isinstance(plan, CapturePlan)}


def test_curves_agree_with_each_other(plans):
    for plan in plans.values():
        course = curves(plan)
        step = course.time[1] - course.time[0]
        # Places come from kinematics and momentum, velocities from Jacobians.
        moved = np.gradient(course.place.reshape(-1, 4), step, axis=0)[1:-1]
        np.testing.assert_allclose(moved, course.velocity[1:-1], atol=2e-6)
        # The net power is the change of kinetic energy: torques come from Lagrange's equations.
        np.testing.assert_allclose(np.gradient(0.5 * course.cost, step)[1:-1], course.net[1:-1], atol=2e-6)
        assert (course.power >= np.abs(course.net) - 1e-15).all()
        np.testing.assert_allclose(
            course.place, polynomial(CANONICAL, course.place[0], course.time), atol=1e-7
        )
        assert np.abs(course.base_rate).max() < 1e-8


def test_energies_are_the_known_ones(plans):
    known = {"zeta_zero": 0.770365391, "local": 0.907150386}
    for key, plan in plans.items():
        found = record(plan, curves(plan), CANONICAL)
        assert found["energy_check"] == pytest.approx(known[key], rel=1e-6)
        assert found["energy"] == pytest.approx(known[key], rel=1e-6)


def test_records_tell_the_methods_apart(plans):
    zero, local = (record(plans[key], curves(plans[key]), CANONICAL) for key in ("zeta_zero", "local"))
    assert np.abs(curves(plans["zeta_zero"]).zeta).max() < 1e-6 < np.abs(curves(plans["local"]).zeta).max()
    assert local["gradient"] < 1e-5 < zero["gradient"]
    assert local["zeta_jolt_time"] > 15.0 and local["zeta_jolt_ratio"] > 4.0
    assert max(zero["path"], zero["end_position"], zero["end_velocity"]) < 1e-6


def test_free_direction_moves_nothing():
    robot = planar_robot()
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 6))
    free = free_direction(robot, q)
    np.testing.assert_allclose((task_rows(robot, q) @ free[..., None])[..., 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(free, axis=1), 1.0)


# The run


def test_a_small_run_for_real(tmp_path, capsys, monkeypatch, request):
    monkeypatch.setattr("reproduce.shah2013.runs.FINE", Tracking(timestep=0.01, control_period=0.01))
    docs, out = tmp_path / "docs", tmp_path / "out"
    docs.mkdir()
    words = "shah2013 --quick --cases 2 --seed 5 --jobs 1".split()
    assert main([*words, "--output", str(out), "--docs", str(docs)]) == 0
    text, summary, written = check_study("shah2013", tmp_path, request)
    assert "A quick run: 2 random cases" in text
    energies = {key: found["energy"] for key, found in summary["canonical"]["methods"].items()}
    assert energies["ocp"] == pytest.approx(0.750548977, rel=1e-6)
    assert energies["ocp_rest"] == pytest.approx(0.750552310, rel=1e-4)
    assert energies["free"] <= 1.02 * 0.455773
    assert [case["index"] for case in summary["cases"]] == [0, 1]
    for case in summary["cases"]:
        for key in METHODS:
            found = case["methods"][key]
            assert found.get("cause") in (None, *map(str, Cause))
            assert ("energy" in found) != ("cause" in found)
    figures = {path.name for path in (out / "figures").iterdir()}
    assert figures >= {f"fig{number}.svg" for number in (2, 3, 4, 5)}
    assert all(name.endswith(".svg") for name in figures)
    assert "as vectors, every 2 s" in written
    assert "shah2013.html" in capsys.readouterr().out
