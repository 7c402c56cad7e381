"""Forks of the process: how simulations and pictures continue in a child.

A forked child has the memory of its parent's thread pools but none of their threads: a call to such a pool,
or its destructor, would never return. Hence a fork waits until no pool is working, the parent's pools are
never destroyed in a child, and a simulation there creates a new pool at its first use. OpenGL has threads
too: contexts opened by the parent are not used in a child.
"""

import ctypes
import os
import threading
import weakref
from typing import Any, Protocol

import mujoco
from mujoco.batch import Batch


def never_end(thing: object) -> None:
    """Leak a reference to an object, so that its destructor never runs."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))


class ForkAware(Protocol):
    """Owner of resources that a forked child cannot use."""

    def after_fork(self) -> None:
        """Set the resources aside for good; called in a forked child."""
        ...


def notify_after_fork(owner: ForkAware) -> None:
    """Register `owner.after_fork` to be called in every forked child."""
    _fork_aware[id(owner)] = owner


class Pool(Batch):
    """A `Batch` that is not interrupted by a fork and not destroyed in a child."""

    def __init__(self, model: mujoco.MjModel, n: int, threads: int) -> None:
        super().__init__(model, n, threads)
        self._lock = threading.RLock()
        _locks[self.state.base] = (
            self._lock
        )  # this object dies with the last view, and its destructor joins the threads

    def step(self, *arguments: Any, **keywords: Any) -> None:
        """Same as `Batch.step`, uninterrupted by a fork."""
        with self._lock:
            super().step(*arguments, **keywords)

    def rollout(self, *arguments: Any, **keywords: Any) -> Any:
        """Same as `Batch.rollout`, uninterrupted by a fork."""
        with self._lock:
            return super().rollout(*arguments, **keywords)

    def forward(self, *arguments: Any, **keywords: Any) -> None:
        """Same as `Batch.forward`, uninterrupted by a fork."""
        with self._lock:
            super().forward(*arguments, **keywords)

    def reset(self, *arguments: Any, **keywords: Any) -> None:
        """Same as `Batch.reset`, uninterrupted by a fork."""
        with self._lock:
            super().reset(*arguments, **keywords)

    def set_const(self, *arguments: Any, **keywords: Any) -> None:
        """Same as `Batch.set_const`, uninterrupted by a fork."""
        with self._lock:
            super().set_const(*arguments, **keywords)

    def jac(self, *arguments: Any, **keywords: Any) -> Any:
        """Same as `Batch.jac`, uninterrupted by a fork."""
        with self._lock:
            return super().jac(*arguments, **keywords)


_locks: "weakref.WeakKeyDictionary[Any, threading.RLock]" = weakref.WeakKeyDictionary()
_fork_aware: "weakref.WeakValueDictionary[int, ForkAware]" = weakref.WeakValueDictionary()
_one_fork = threading.Lock()
_held: list[tuple[Any, Any]] = []  # pools and their locks, while a fork is under way


def _before() -> None:
    _one_fork.acquire()
    for reference in _locks.keyrefs():
        pool = reference()
        if pool is not None:
            lock = _locks[pool]
            lock.acquire()
            never_end(pool)  # in a child
            _held.append((pool, lock))


def _after_in_parent() -> None:
    while _held:
        pool, lock = _held.pop()
        ctypes.pythonapi.Py_DecRef(ctypes.py_object(pool))
        lock.release()
    _one_fork.release()


def _after_in_child() -> None:
    while _held:
        _held.pop()[1].release()
    for reference in _fork_aware.valuerefs():
        owner = reference()
        if owner is not None:
            owner.after_fork()
    _one_fork.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_parent=_after_in_parent, after_in_child=_after_in_child)
