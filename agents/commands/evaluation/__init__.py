"""Evaluations after their options were checked: estimated time, run, defects of built-in policies."""
