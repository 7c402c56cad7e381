"""Description of a training run: settings, hyperparameters with their defaults, its folder, its time."""
