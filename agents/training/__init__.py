"""Parts of a training run: its folder, models, checkpoints, validation, progress."""
