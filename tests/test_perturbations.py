"""Robots that differ from the model that policies know: what is drawn, simulated, observed and recorded."""

import copy
import json
import pickle
from dataclasses import replace

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.commands import evaluate
from agents.policies.registry import make_policy
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.perturbations.amounts import PRESETS, Perturbation
from space_envs.perturbations.draws import episode_draws
from space_envs.perturbations.friction import dry_friction
from space_envs.perturbations.masses import perturbed_moments
from space_envs.perturbations.sensors import SENSOR_ERRORS
from space_envs.policy import PolicyContext
from space_envs.registration import ENTRIES

ID = "SpaceCapture/SingleArm-v0"
EVERYTHING = "severe locked_joint=0.5 satellite_mass=1.1"


def made(env_id=ID, n=3, perturbation=EVERYTHING, **keywords):
    env = CaptureVectorEnv(
        env_id, n, autoreset_mode="disabled", split="validation", perturbation=perturbation, **keywords
    )
    return env, env.reset(seed=7, options={"index": np.arange(n)})[0]


def actions(env, count, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, *env.action_space.shape))


# Texts ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", [*PRESETS, "mass=0.1 action_delay=2", "mild locked_joint=1", "noise=0.30000001"]
)
def test_a_perturbation_reads_what_it_writes(text):
    perturbation = Perturbation.of(text)
    assert Perturbation.of(perturbation.text) == perturbation
    assert perturbation.nominal == (text == "nominal")
    if text in PRESETS:
        assert perturbation.text == text


def test_later_amounts_change_a_preset():
    assert Perturbation.of("severe mass=0.1") == replace(PRESETS["severe"], mass=0.1)
    assert Perturbation.of("mild  mass=0.05") is not None and Perturbation.of("mild mass=0.05").text == "mild"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sever", "Did you mean 'severe'"),
        ("masss=0.1", "Did you mean 'mass'"),
        ("mild severe", "after the first word"),
        ("mass=heavy", "mass must be a number, got 'heavy'"),
        ("mass=0.6", "mass must lie in 0 to 0.5"),
        ("mass=-0.1", "at least 0"),
        ("mass=nan", "finite"),
        ("action_delay=1.5", "a whole number"),
        ("action_delay=11", "from 0 to 10"),
        ("satellite_mass=0.01", "0.1 to 10"),
        ("", "must be a Perturbation or words"),
        (0.1, "must be a Perturbation or words"),
    ],
)
def test_other_texts_are_refused(text, message):
    with pytest.raises(ConfigurationError, match=message):
        CaptureVectorEnv(ID, 1, perturbation=text)


# Masses --------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(
    arrays(float, 3, elements=st.floats(0.0, 1e3)),
    arrays(float, 3, elements=st.floats(-0.5, 0.5)),
    st.floats(0.1, 1e3),
)
def test_perturbed_inertias_are_physically_consistent(second, error, mass):
    inertia = second.sum() - second
    found = perturbed_moments(inertia, error)
    slack = 1e-9 * (1.0 + found.sum())
    pseudo = np.diag([*(0.5 * found.sum() - found), mass])  # about the centre of mass, in principal axes
    assert (np.linalg.eigvalsh(pseudo) >= -slack).all()
    assert all(found[i] + found[j] >= found[k] - slack for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)))
    assert (np.abs(found / np.maximum(inertia, 1e-9) - 1.0) <= 0.5 + 1e-6)[inertia > 1e-6].all()


def test_draws_stay_within_their_amounts_and_fill_them():
    keys = np.stack([np.arange(400), np.ones(400, dtype=np.int64)], axis=1)
    draws = episode_draws(
        Perturbation(mass=0.2, inertia=0.1, dry_friction=0.05, locked_joint=0.3), keys, 8, 7
    )
    for values, least, largest in (
        (draws.mass, 0.8, 1.2),
        (draws.inertia, -0.1, 0.1),
        (draws.dry_friction, 0.0, 0.05),
    ):
        width = largest - least
        assert (
            least <= values.min() < least + 0.01 * width and largest - 0.01 * width < values.max() <= largest
        )
    assert not draws.viscous_friction.any()
    assert (draws.locked.sum(axis=1) <= 1).all()
    assert 0.22 < draws.locked.any(axis=1).mean() < 0.38
    assert draws.locked.any(axis=0).all()


def test_a_factor_is_the_same_alone_and_with_others():
    keys = np.array([[5, 1]])
    alone, together = (episode_draws(Perturbation.of(text), keys, 8, 7) for text in ("mass=0.2", "severe"))
    np.testing.assert_array_equal(alone.mass, together.mass)


# Simulation ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", ENTRIES)
@pytest.mark.parametrize("mode", ["joint_velocity", "joint_torque"])
def test_momentum_is_conserved_and_locked_joints_stay(env_id, mode):
    env, _ = made(env_id, 4, "severe locked_joint=1 mass=0.5", control_mode=mode, collisions=False)
    start, states = env.simulation.joint_position.copy(), [env.simulation.robot_state()]
    for action in np.repeat(actions(env, 5), 8, axis=0):
        env.step(action)
        states.append(env.simulation.robot_state())
    qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
    factor, inertia = env.simulation.mass_factor[:, None], env.simulation.inertia()[:, None]
    motion = body_motion(env.task.mechanics, qpos, qvel, factor, inertia)
    assert momentum_drift(motion)[1].max() <= 1e-6
    assert momentum_drift(body_motion(env.task.mechanics, qpos, qvel))[1].max() > 1e-4  # nominal masses
    moved = np.abs(env.simulation.joint_position - start)
    assert moved[env.drive.locked].max() < 1e-4 < 1e-2 < moved[~env.drive.locked].max()


def test_simulated_masses_are_those_of_a_compiled_model():
    env, _ = made(n=2, perturbation="mass=0.2 inertia=0.2")
    model = copy.copy(env.task.model)
    bodies = [body for body in range(model.nbody) if model.body_rootid[body] == model.jnt_bodyid[0]]
    model.body_mass[bodies] *= env.simulation.mass_factor[1]
    model.body_inertia[bodies] = env.simulation.moments[1] * env.simulation.mass_factor[1][:, None]
    data = mujoco.MjData(model)
    data.qpos[:] = env.simulation.qpos[1]
    mujoco.mj_setConst(model, data)
    data.qpos[:] = env.simulation.qpos[1]
    mujoco.mj_forward(model, data)
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    size = 6 + env.simulation.n_joints
    np.testing.assert_allclose(env.simulation.mass_matrix()[1], dense[:size, :size], rtol=1e-9, atol=1e-9)
    assert not np.allclose(env.simulation.mass_factor[0], env.simulation.mass_factor[1])


def test_dry_friction_stops_a_joint_or_is_at_its_limit():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((50, 5, 5))
    inverse, rate = root @ root.swapaxes(1, 2) + 0.1 * np.eye(5), rng.standard_normal((50, 5))
    limit = rng.uniform(0.0, 3.0, (50, 5))
    torque = np.zeros((50, 5))
    for _ in range(60):  # the guess of the next call is the result of the last
        torque = dry_friction(inverse, rate, limit, 0.1, torque)
    after = rate + 0.1 * (inverse @ torque[..., None])[..., 0]
    full = np.abs(torque) >= limit - 1e-9
    assert np.abs(after[~full]).max() < 1e-6
    assert (torque * after <= 1e-9).all()  # it never drives
    assert full.any() and not full.all()


def test_actions_and_observations_are_late():
    plain, _ = made(n=2, perturbation="nominal")
    late, _ = made(n=2, perturbation="action_delay=2")
    given = actions(plain, 8)
    for step in range(8):
        plain.step(given[step - 2] if step >= 2 else np.zeros_like(given[0]))
        late.step(given[step])
    np.testing.assert_allclose(late.simulation.qpos, plain.simulation.qpos, atol=1e-12)

    old, first = made(n=2, perturbation="observation_delay=2")
    fresh, same = made(n=2, perturbation="nominal")
    np.testing.assert_array_equal(first, same)
    read, true = old.task.layout.read, [same]
    for step in range(6):
        seen = old.step(given[step])[0]
        true.append(fresh.step(given[step])[0])
        np.testing.assert_array_equal(
            read(seen, "joint_position"), read(true[max(step - 1, 0)], "joint_position")
        )
        np.testing.assert_array_equal(read(seen, "time"), read(true[-1], "time"))


def test_noise_and_bias_have_their_deviations_and_leave_the_truth_alone():
    env, first = made(n=200, perturbation="noise=2 bias=1")
    layout, zero = env.task.layout, np.zeros(env.action_space.shape)
    true = made(n=200, perturbation="nominal")[1]
    np.testing.assert_array_equal(env.episodes.observation, true)
    seen = np.stack([first, *(env.step(zero)[0] for _ in range(20))])
    deviation = SENSOR_ERRORS[mujoco.mjtSensor.mjSENS_JOINTPOS].deviation
    error = layout.read(seen - true, "joint_position")
    assert error.mean(axis=0).std() == pytest.approx(deviation, rel=0.2)
    assert (error - error.mean(axis=0)).std() == pytest.approx(2.0 * deviation, rel=0.1)
    for name in ("base_quaternion", "end_effector_quaternion"):
        np.testing.assert_allclose(np.linalg.norm(layout.read(seen, name), axis=-1), 1.0, atol=1e-9)
    # Errors of a measured pose are those of the measured positions.
    goal, hand = (layout.read(seen, f"{name}_position") for name in ("goal", "end_effector"))
    np.testing.assert_allclose(layout.read(seen, "position_error"), goal - hand, atol=1e-12)
    peak = layout.read(seen, "peak_attitude")
    assert (np.diff(peak, axis=0) >= 0.0).all() and 0.0 < peak[-1].max() < 0.01


# Seeds ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", ENTRIES)
def test_an_episode_is_the_same_alone_and_in_a_batch(env_id):
    env, observation = made(env_id)
    single = gym.make(env_id, split="validation", perturbation=EVERYTHING).unwrapped
    first, _ = single.reset(seed=8, options={"index": 1})
    np.testing.assert_array_equal(first, observation[1])
    for action in actions(env, 70)[:, :, :]:  # longer than a block of noise
        seen, reward, *_ = env.step(action)
        alone, own, *_ = single.step(action[1])
        np.testing.assert_array_equal(alone, seen[1])
        assert own == reward[1]


def test_goal_and_seed_decide_the_draw():
    def masses(seed, index):
        env = CaptureVectorEnv(ID, 1, perturbation="mass=0.2")
        env.reset(seed=seed, options={"index": index})
        return env.simulation.mass_factor[0]

    np.testing.assert_array_equal(masses(3, 5), masses(3, 5))
    assert not np.array_equal(masses(3, 5), masses(3, 6))
    assert not np.array_equal(masses(3, 5), masses(4, 5))


def test_episodes_that_follow_are_drawn_anew():
    env = CaptureVectorEnv(ID, 1, autoreset_mode="next_step", horizon=1, perturbation="mass=0.2")
    env.reset(seed=0)
    before, zero = env.simulation.mass_factor.copy(), np.zeros(env.action_space.shape)
    for _ in range(2):
        env.step(zero)
    assert not np.array_equal(before, env.simulation.mass_factor)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_continue_alike(copied):
    env, _ = made()
    for action in actions(env, 5):
        env.step(action)
    other = copied(env)
    for action in actions(env, 70, seed=1):
        np.testing.assert_array_equal(env.step(action)[0], other.step(action)[0])


def test_the_final_observation_of_an_episode_is_what_was_measured():
    env = CaptureVectorEnv(ID, 2, autoreset_mode="same_step", horizon=2, perturbation="noise=1")
    env.reset(seed=0)
    zero = np.zeros(env.action_space.shape)
    env.step(zero)
    *_, info = env.step(zero)
    time = env.task.layout.read(info["final_obs"][0], "time")
    assert time == pytest.approx(2 * env.task.control_period)
    assert env.task.layout.read(info["final_obs"][0], "joint_velocity").any()  # at rest: noise


# Evaluation ----------------------------------------------------------------------------------------------


def test_policies_know_the_nominal_model():
    contexts = [PolicyContext.from_env(made(perturbation=text)[0]) for text in ("nominal", "severe")]
    nominal, severe = contexts
    np.testing.assert_array_equal(nominal.model.body_mass, severe.model.body_mass)
    np.testing.assert_array_equal(nominal.arm.inertia, severe.arm.inertia)


def test_metrics_are_of_the_true_state():
    environment = {"env_id": ID, "split": "validation", "perturbation": "noise=100 bias=100", "horizon": 5}
    rollout = roll_out(
        lambda context: make_policy("hold", context, 0), environment, "validation", np.arange(3), 0
    )
    assert rollout.attitude.max() < 1e-6 and rollout.peak_attitude.max() < 1e-6
    assert np.ptp(rollout.position_error, axis=1).max() < 1e-6
    assert np.ptp(rollout.observation, axis=1).max() > 0.01


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("perturbed")
    words = "--policy gjm --episodes 3 --split validation --no-pictures --jobs 1".split()
    for name, perturbations in {"plain": [], "both": [["nominal"], ["mass=0.2", "noise=1"]]}.items():
        given_words = [word for each in perturbations for word in ("--perturb", *each)]
        assert evaluate.main([*words, *given_words, "--output", str(folder / name)]) == 0
    return folder


def lines(folder):
    return [json.loads(line) for line in (folder / "records.jsonl").read_text().splitlines()]


def test_records_say_how_the_robot_was_perturbed(results):
    plain, both = lines(results / "plain"), lines(results / "both")
    untimed = [{k: v for k, v in record.items() if k != "timing"} for record in plain + both]
    assert untimed[:3] == untimed[3:6]
    assert all("perturbation" not in record for record in untimed[:6])
    assert [record["perturbation"] for record in both[3:]] == ["mass=0.2 noise=1.0"] * 3
    assert len({record["config_hash"] for record in both}) == 2
    record = EpisodeRecord.from_dict(both[3])
    assert record.entry.task.perturbation == "mass=0.2 noise=1.0"
    with pytest.raises(ConfigurationError, match="expected 'mass=0.2 noise=1.0'"):
        replace(record, perturbation="noise=1 mass=0.2", checksum="")
    summary = json.loads((results / "both" / "summary.json").read_text())
    found = summary["provenance"]["configurations"][record.config_hash]["perturbation"]
    assert Perturbation(**found) == Perturbation(mass=0.2, noise=1.0)


def test_results_of_different_perturbations_are_not_compared(results, capsys, tmp_path):
    arguments = "--policy gjm --episodes 3 --split validation --no-pictures --jobs 1 --perturb mild".split()
    assert evaluate.main([*arguments, "--output", str(tmp_path / "mild")]) == 0
    capsys.readouterr()
    folders = [str(results / "plain"), str(tmp_path / "mild"), "--output", str(tmp_path / "merged")]
    assert evaluate.main(["compare", *folders]) == 2
    assert "differs in its perturbation" in capsys.readouterr().err
    assert evaluate.main(["compare", *folders, "--separate"]) == 0


def test_a_replay_is_chosen_by_its_perturbation(results, capsys):
    words = ["replay", str(results / "both"), "--episode", "0", "--video", str(results / "x.txt")]
    assert evaluate.main(words) == 2
    words[-1] = str(results / "x.mp4")
    assert evaluate.main(words) == 2
    assert "several of --perturbation" in capsys.readouterr().err


def test_a_dataset_of_a_perturbed_robot_repeats_from_its_actions(tmp_path):
    words = "dataset --policy gjm --episodes 2 --jobs 1 --perturb severe locked_joint=0".split()
    assert evaluate.main([*words, "--output", str(tmp_path)]) == 0
    (card,) = tmp_path.rglob("dataset.json")
    about = json.loads(card.read_text())
    assert about["episodes"]["written"] == 2 and not about["episodes"]["omitted"]
    assert Perturbation.of(about["request"]["perturbation"]) == replace(PRESETS["severe"], locked_joint=0.0)


def test_an_unknown_perturbation_ends_the_command(capsys):
    assert evaluate.main(["--policy", "gjm", "--episodes", "1", "--perturb", "sever"]) == 2
    assert "Did you mean 'severe'" in capsys.readouterr().err
