"""Descriptions of robots that several tests share."""

# Six joints on a small satellite, without time steps and acceleration limits of its own.
SIX_JOINTS = """
[satellite]
mass = 150.0
size = 0.8
[[arm]]
mount = { position = [0.0, 0.0, 0.4] }
radius = 0.05
rotor_inertia = 0.05
home = [0.0, 1.2, -1.6, -0.3, 0.9, 0.0]
links = [
  { alpha = 1.5707963267948966, d = 0.3, mass = 5.0 },
  { a = 0.6, mass = 7.0 },
  { a = 0.5, mass = 5.0 },
  { alpha = 1.5707963267948966, d = 0.12, mass = 2.0 },
  { alpha = -1.5707963267948966, d = 0.12, mass = 2.0 },
  { d = 0.15, mass = 1.5 },
]
[arm.limits]
rate = 0.4
torque = [60.0, 60.0, 40.0, 15.0, 15.0, 10.0]
range = [[-3.0, 3.0], [-3.0, 3.0], [-3.0, 3.0], [-3.0, 3.0], [-3.0, 3.0], [-3.0, 3.0]]
"""
