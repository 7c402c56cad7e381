"""Learned policies: networks, features, files and Stable-Baselines3 models."""
