"""Training: behaviour cloning, reinforcement by stable-baselines3, validation, sweeps of runs."""
