"""Control from the learned distribution (sec. VII): policy `promp_feedback` in MuJoCo, on one goal."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from agents.policies.single_arm.promp import ConditionalMean, ProMPPolicy
from agents.policies.single_arm.promp_feedback import POSITION_NOISE, RATE_NOISE, PrompFeedback
from reproduce.figures import Figure, Sketch, figure
from reproduce.page import Table
from reproduce.shyam2020.cases import DIFFICULTY, ENV_ID, C, Case, context
from reproduce.shyam2020.sampling import joint_goal, prior
from reproduce.shyam2020.tables import short
from space_envs.dynamics import attitude_cost
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.report.drawing import INK
from space_envs.evaluation.report.figures import BLUE, SKY, VERMILION

EPISODES = 48  # drawn by the law
LINES = 12  # of them that are drawn
BAND = 2.0  # standard deviations on either side of the mean
JOINTS = (1, 3)  # counted from 0, in the figure
NEVER = 1e-9  # m, so near a goal that episodes go on to the end of the motion


@dataclass(frozen=True, eq=False)
class Played:
    """E episodes of a policy in MuJoCo, from home to one goal.

    Attributes:
        time: (T,) s. joints: (E, T, 7) rad. missed: (E,) m and turned_off: (E,) rad, of the end-effector at
            the end of the motion. attitude: (E,) rad, of the base there. cost: (E,) m^2/s, eq. 20 times dt.
    """

    time: Array
    joints: Array
    missed: Array
    turned_off: Array
    attitude: Array
    cost: Array


@dataclass(frozen=True, eq=False)
class Feedback:
    """What the law does beside what the distribution says.

    Attributes:
        mean: (T, 7) rad and spread: (T, 7) rad, standard deviation, of the ProMP conditioned on start and
            goal. drawn, expected, followed, best: accelerations drawn; expected ones; the conditional mean
            followed by the suite's tracking; the best of 100 likewise.
    """

    mean: Array
    spread: Array
    drawn: Played
    expected: Played
    followed: Played
    best: Played


def play(case: Case, kind: type[ProMPPolicy], seed: int, episodes: int, deterministic: bool = True) -> Played:
    """Play a policy on a goal until its motion is over."""
    envs = CaptureVectorEnv(ENV_ID, episodes, difficulty=DIFFICULTY, position_tolerance=NEVER)
    try:
        at = context()
        options = {
            "goal_position": np.tile(case.position, (episodes, 1)),
            "goal_quaternion": np.tile(case.quaternion, (episodes, 1)),
        }
        policy, read = kind(at, seed), at.layout.read
        observation, _ = envs.reset(seed=seed, options=options)
        state, joints, cost = None, [read(observation, "joint_position").copy()], np.zeros(episodes)
        steps = len(prior().times) - 1
        for step in range(steps):
            start = np.full(episodes, step == 0)
            action, state = policy.predict(observation, state, start, deterministic)
            before = _integrand(observation)
            observation, *_ = envs.step(action)
            joints.append(read(observation, "joint_position").copy())
            cost += 0.5 * at.control_period * (before + _integrand(observation))
        still = np.tile([1.0, 0.0, 0.0, 0.0], (episodes, 1))
        return Played(
            prior().times,
            np.stack(joints, axis=1),
            np.linalg.norm(read(observation, "end_effector_position") - case.position, axis=1),
            angle_between(
                read(observation, "end_effector_quaternion"), np.tile(case.quaternion, (episodes, 1))
            ),
            angle_between(read(observation, "base_quaternion"), still),
            cost,
        )
    finally:
        envs.close()


def _integrand(observation: Array) -> Array:
    """Eq. 20 (N,), m^2/s^2, of the base as it is observed."""
    read = context().layout.read
    twist = np.concatenate(
        [read(observation, "base_linear_velocity"), read(observation, "base_angular_velocity")], axis=1
    )
    return attitude_cost(twist[:, None, :], 1.0, C)


def control(case: Case, seed: int) -> Feedback | None:
    """The law on a goal; None where the distribution has no joint goal for it."""
    goal = joint_goal(case)
    if goal is None:
        return None
    at = prior()
    weights = at.weights(case.start[None], np.zeros((1, len(goal))), goal[None])
    covariance = at.free.state(at.times / at.times[-1], float(at.times[-1]))[1]
    variance = np.diagonal(covariance, axis1=1, axis2=2)[:, : len(goal)]
    return Feedback(
        at.motion(weights).position[0],
        np.sqrt(np.maximum(variance, 0.0)),
        play(case, PrompFeedback, seed, EPISODES, deterministic=False),
        play(case, PrompFeedback, seed, 1),
        play(case, ConditionalMean, seed, 1),
        play(case, ProMPPolicy, seed, 1),
    )


def feedback_figure(found: Feedback) -> Figure:
    """Joint angles under the law against the distribution, and the spreads over time."""
    time = found.drawn.time

    def joint(number: int) -> Sketch:
        mean, spread = np.rad2deg(found.mean[:, number]), np.rad2deg(found.spread[:, number])

        def draw(axes: Axes) -> None:
            low, high = mean - BAND * spread, mean + BAND * spread
            axes.fill_between(time, low, high, color=SKY, alpha=0.35, lw=0, label=f"ProMP, ±{BAND:g} σ")
            for row in range(min(LINES, len(found.drawn.joints))):
                line = np.rad2deg(found.drawn.joints[row, :, number])
                axes.plot(time, line, color=BLUE, lw=0.8, label="drawn, in MuJoCo" if row == 0 else None)
            expected = np.rad2deg(found.expected.joints[0, :, number])
            axes.plot(time, expected, color=VERMILION, lw=1.8, label="expected, in MuJoCo")
            axes.set(xlabel="time [s]", ylabel=f"joint {number + 1} [deg]")
            axes.legend(fontsize=8)
            axes.grid()

        inside = np.abs(found.drawn.joints[:, :, number] - found.mean[:, number])
        share = (inside <= BAND * found.spread[:, number] + 1e-3).mean()
        return Sketch(
            draw,
            f"Joint {number + 1} under the law: {100 * share:.0f} % of the time within {BAND:g} standard "
            "deviations of the ProMP.",
        )

    simulated, wanted = found.drawn.joints.std(axis=0), found.spread

    def spreads(axes: Axes) -> None:
        for values, colour, style, name in (
            (wanted, INK, "--", "ProMP"),
            (simulated, BLUE, "-", f"{EPISODES} episodes in MuJoCo"),
        ):
            overall = np.rad2deg(np.sqrt((values**2).mean(axis=1)))
            axes.plot(time, overall, color=colour, ls=style, lw=1.8, label=name)
        axes.set(xlabel="time [s]", ylabel="spread of the joints [deg]")
        axes.set_ylim(bottom=0)
        axes.legend(fontsize=8)
        axes.grid()

    ratio = spread_ratio(found)
    return figure(
        "feedback",
        "Joint motions under the law",
        "Policy promp_feedback on the page's own goal, torques of the suite's drives on a floating base in "
        "MuJoCo. Its gains and its noise are those under which motions are distributed as the ProMP that is "
        "conditioned on start and goal. Right: standard deviation, root mean square over the joints.",
        (
            *(joint(number) for number in JOINTS),
            Sketch(spreads, f"Spread of the simulated joints over that of the ProMP: {ratio:.2f}."),
        ),
        height=3.0,
    )


def spread_ratio(found: Feedback) -> float:
    """Root mean square of the simulated joints' spread over that of the ProMP."""
    return float(np.sqrt((found.drawn.joints.var(axis=0)).mean() / (found.spread**2).mean()))


def feedback_table(found: Feedback) -> Table:
    """What the law leaves at the end of the motion, beside tracking of a plan."""
    rows = []
    for name, played in (
        (f"law, drawn ({len(found.drawn.cost)} episodes)", found.drawn),
        ("law, expected accelerations", found.expected),
        ("conditional mean, tracked", found.followed),
        ("best of 100, tracked", found.best),
    ):
        values = (1e4 * played.cost, np.rad2deg(played.attitude), 1e3 * played.missed)
        rows.append(
            (
                name,
                *(short(float(np.median(value))) for value in values),
                short(1e3 * float(played.missed.max())),
                f"{np.rad2deg(np.median(played.turned_off)):.2f}",
            )
        )
    return Table(
        "The law at the end of the motion",
        (
            "controller",
            "eq. 20 [cm²/s]",
            "end attitude [deg]",
            "goal error [mm]",
            "largest [mm]",
            "goal error [deg]",
        ),
        tuple(rows),
        "Page's own goal, simulated by MuJoCo for the 10 s of the motion; medians if nothing else is said. "
        "Drawn motions end beside the mean since the law does not correct what is below the errors of "
        f"measurement that it is told of, {POSITION_NOISE:g} rad and {RATE_NOISE:g} rad/s, and the base ends "
        "elsewhere under each; the policy then corrects the end-effector's pose. On the leaderboard it acts "
        "by expected accelerations.",
    )
