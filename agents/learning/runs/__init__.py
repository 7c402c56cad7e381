"""What a training run is: settings, hyperparameters with their defaults, and the folder that keeps it."""
