"""Tasks: observations, rewards and capture conditions. One file per task."""
