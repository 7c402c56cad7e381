"""Forks of the process: how simulations and pictures continue in a child.

A forked child has the memory of its parent's thread pools, and none of their threads: what it asks of such a
pool waits for ever, and so does the pool's end. Hence a fork waits until no pool is at work, the pools of the
parent never end in a child, and a simulation there makes a pool of its own when it is first used. OpenGL has
threads too; what was opened by the parent is left to it.
"""

import ctypes
import os
import threading
import weakref
from typing import Any, Protocol

import mujoco
from mujoco.batch import Batch


def never_end(thing: object) -> None:
    """Keep a thing for ever: not even the end of the interpreter runs its destructor."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))


class Heir(Protocol):
    """Owner of resources that a forked child cannot use."""

    def leave_to_parent(self) -> None:
        """Set the resources aside, for ever; called in a forked child."""
        ...


def tell_child(heir: Heir) -> None:
    """Have `heir.leave_to_parent` called in every forked child."""
    _heirs[id(heir)] = heir


class Pool(Batch):
    """A `Batch` that a fork of the process does not interrupt, and that does not end in a child."""

    def __init__(self, model: mujoco.MjModel, n: int, threads: int) -> None:
        super().__init__(model, n, threads)
        self._lock = threading.RLock()
        _locks[self.state.base] = self._lock  # what ends with the last view, and ends the threads

    def step(self, *arguments: Any, **keywords: Any) -> None:
        """Same as `Batch.step`, uninterrupted by a fork."""
        with self._lock:
            super().step(*arguments, **keywords)

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
_heirs: "weakref.WeakValueDictionary[int, Heir]" = weakref.WeakValueDictionary()
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
    for reference in _heirs.valuerefs():
        heir = reference()
        if heir is not None:
            heir.leave_to_parent()
    _one_fork.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_parent=_after_in_parent, after_in_child=_after_in_child)
