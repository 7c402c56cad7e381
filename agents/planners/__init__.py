"""Planners: functions from a problem to a plan or a typed failure, independent of environments."""
