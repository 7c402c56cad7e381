"""Stable-Baselines3: its view of the environments, its models and what a checkpoint holds of them."""
