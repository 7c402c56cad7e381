"""Training: behaviour cloning, reinforcement learning, runs, validation and sweeps."""
