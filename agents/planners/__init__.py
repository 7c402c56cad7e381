"""Planners: a problem in, a plan or a typed failure out, with no environment in sight."""
