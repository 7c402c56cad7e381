"""Figures of a robot: of its description, of many configurations, and measured in simulation."""
