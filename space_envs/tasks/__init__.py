"""Tasks: what is observed, what is rewarded, what counts as a capture. One file per task."""
