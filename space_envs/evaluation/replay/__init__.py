"""Recorded episodes: states, traces, scenes and exports."""
