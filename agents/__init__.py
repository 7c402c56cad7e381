"""Experts, demonstrations and learned policies."""
