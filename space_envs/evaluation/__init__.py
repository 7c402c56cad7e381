"""The harness: policies, rollouts, metrics, statistics and the report."""
