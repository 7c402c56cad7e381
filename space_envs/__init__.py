"""Gymnasium environments for free-floating space-robot capture; importing the package registers every id."""

from space_envs.registration import register_all

register_all()
