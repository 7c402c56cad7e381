"""Outcomes and rewards of episodes from what is seen at a few instants, by the task's own functions."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.outcome import Outcome
from space_envs.tasks.rewards import StepQuantities


class Seen(NamedTuple):
    """k episodes at instants 0, ..., M.

    Attributes:
        observation: (k, M + 1, size). sensors: (k, M + 1, s).
        length: (k, M) control periods between instants.
        held: (k,) control periods inside the capture envelope up to the first instant.
    """

    observation: Array
    sensors: Array
    length: Array
    held: Array


class Judged(NamedTuple):
    """Result of k episodes.

    Attributes:
        terms: (k, t) sums of the weighted reward terms. outcome: (k,) codes. last: (k,) instant of the end.
        observation: (k, size) there. held: (k,) as in `Seen`.
    """

    terms: Array
    outcome: NDArray[np.int64]
    last: NDArray[np.int64]
    observation: Array
    held: Array


def judged(task: CaptureTask, seen: Seen, rate_limit: Array, over: bool) -> Judged:
    """Result of episodes; between two instants what is paid each second changes linearly.

    Args:
        rate_limit: (n,) rad/s, a unit of action. over: whether the last instant is the horizon.
    """
    k, count = seen.observation.shape[:2]
    flat = seen.observation.reshape(k * count, -1)
    errors, attitude = task.errors(flat), task.attitude(flat)
    held = _held(errors.within(task.limits).reshape(k, count), seen)
    touched = _touched(task, seen.sensors) if task.collisions else np.zeros((k, count), dtype=bool)
    failed = touched | (attitude > task.attitude_limit_rad).reshape(k, count)
    captured = ~failed & (held > task.hold_steps)
    ends = captured | failed
    every, last = np.arange(k), np.where(ends.any(axis=1), ends.argmax(axis=1), count - 1)
    outcome = np.full(k, Outcome.TIMEOUT.code if over else Outcome.RUNNING.code)
    kinds = (captured, Outcome.CAPTURED), (failed, Outcome.ATTITUDE_LOST), (touched, Outcome.COLLISION)
    for mask, kind in kinds:
        outcome[mask[every, last]] = kind.code
    # The last instant may lie at the end of a rest, during which a hold is completed sooner.
    early = np.where(captured[every, last], held[every, last] - (task.hold_steps + 1.0), 0.0)
    early = np.clip(early, 0.0, np.maximum(seen.length[every, last - 1] - 1.0, 0.0))
    final = seen.observation[every, last]
    final[:, task.layout.slices["time"].start] -= early * task.control_period
    length = seen.length * (np.arange(1, count) <= last[:, None])
    length[every, last - 1] -= early
    at_end = np.arange(count) == last[:, None]
    before = np.maximum(np.arange(count) - 1, 0)
    step = StepQuantities(
        observation=flat,
        previous=seen.observation[:, before].reshape(k * count, -1),
        action=task.layout.read(flat, "joint_velocity") / rate_limit,
        errors=errors,
        attitude=attitude,
        captured=(captured & at_end).ravel(),
        failed=(failed & at_end).ravel(),
        layout=task.layout,
        limits=task.limits,
    )
    return Judged(_terms(task, step, length, last), outcome, last, final, held[every, last])


def _held(inside: NDArray[np.bool_], seen: Seen) -> Array:
    """Control periods (k, M + 1) inside the envelope at each instant, from whether it is inside there."""
    counted, held = np.zeros(inside.shape), seen.held
    for instant, length in enumerate(seen.length.T, start=1):
        entered = held == 0.0  # at an unknown time since the instant before
        held = np.where(entered, 1.0, held + length) * inside[:, instant]
        counted[:, instant] = held
    return counted


def _touched(task: CaptureTask, sensors: Array) -> NDArray[np.bool_]:
    """Whether a link touched something since the instant before (k, M + 1); sensors (k, M + 1, s)."""
    before = sensors[:, np.maximum(np.arange(sensors.shape[1]) - 1, 0)]
    flat = (each.reshape(-1, sensors.shape[-1]) for each in (before, sensors))
    touched = task.collided(*flat).reshape(sensors.shape[:2]) > 0
    touched[:, 0] = False
    return touched


def _terms(task: CaptureTask, step: StepQuantities, length: Array, last: NDArray[np.int64]) -> Array:
    """Sums (k, t) of the weighted reward terms between M + 1 instants that are length (k, M) apart.

    Args:
        last: (k,) instant of the end.
    """
    passed = length > 0.0
    lasting = np.zeros((len(length), length.shape[1] + 1))  # control periods, of the value at each instant
    lasting[:, 1:] += 0.5 * (length + passed)
    lasting[:, :-1] += 0.5 * (length - passed)
    once, terms = np.pad(passed, ((0, 0), (1, 0))), np.empty((len(length), len(task.reward_terms)))
    every, captured = np.arange(len(length)), step.captured.reshape(once.shape)
    for column, term in enumerate(task.reward_terms):
        values, first = term.function(step).reshape(once.shape), term.rate(0.0)
        if term.per == "change":  # of a potential, which is 0 at a capture
            end = np.where(captured[every, last], 0.0, values[every, last])
            terms[:, column] = first * (end - values[:, 0])
        else:
            weight = first * once + (term.rate(task.control_period) - first) * lasting
            terms[:, column] = (values * weight).sum(axis=1)
    return terms
