"""Evaluations that can be stopped and resumed: chunks of episodes played in any process, results, timing."""
