"""Meshes that robot files name."""
