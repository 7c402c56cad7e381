"""Descriptions of robots that the project does not know, one for each kind of task."""

SIX_JOINTS = """
name = "six_joints"
[satellite]
mass = 300.0
size = [1.0, 0.8, 0.8]
[[arm]]
mount = { position = [0.1, 0.0, 0.4] }
radius = 0.06
home = [0.3, -0.9, 1.4, 0.4, 1.1, 0.2]
links = [
  { alpha = 1.5707963267948966, d = 0.3, mass = 8.0 },
  { a = 0.9, mass = 10.0 },
  { a = 0.7, mass = 8.0 },
  { alpha = 1.5707963267948966, d = 0.15, mass = 3.0 },
  { alpha = -1.5707963267948966, d = 0.15, mass = 3.0 },
  { d = 0.2, mass = 2.0 },
]
[arm.limits]
rate = [0.4, 0.4, 0.4, 0.5, 0.5, 0.6]
acceleration = 0.3
torque = [80.0, 80.0, 60.0, 20.0, 20.0, 15.0]
range = [[-2.9, 2.9], [-2.9, 0.3], [-2.5, 2.5], [-3.0, 3.0], [-2.0, 2.0], [-3.0, 3.0]]
[simulation]
timestep = 0.01
largest_control_period = 0.1
"""

_PLANAR_ARM = """
[[arm]]
mount = {{ position = [{x}, 0.3, 0.0] }}
radius = 0.04
home = {home}
links = [
    {{ a = 0.7, mass = 8.0 }},
    {{ a = 0.7, mass = 8.0 }},
    {{ a = 0.6, mass = 6.0 }},
    {{ a = 0.4, mass = 4.0 }},
]
[arm.limits]
rate = 0.3
acceleration = 0.2
torque = 50.0
range = [[-3.0, 3.0], [-2.7, 2.7], [-2.7, 2.7], [-2.7, 2.7]]
"""
PLANAR_FOUR = (
    """
name = "planar_four"
planar = true
[satellite]
mass = 400.0
size = 1.0
reachable = false
[simulation]
timestep = 0.02
largest_control_period = 0.1
"""
    + _PLANAR_ARM.format(x=0.4, home=[-0.6, 0.9, 0.5, 0.3])
    + _PLANAR_ARM.format(x=-0.4, home=[1.4, -0.4, -0.6, -0.3])
)

_SIX_JOINT_ARM = """
[[arm]]
mount = {{ position = [{x}, 0.35, 0.0], quaternion = [0.7071067811865476, 0.0, {y}, 0.0] }}
radius = 0.05
rotor_inertia = 0.3
home = {home}
links = [
    {{ alpha = -1.5707963267948966, d = 0.25, mass = 10.0 }},
    {{ a = 0.55, mass = 12.0 }},
    {{ a = 0.5, mass = 10.0 }},
    {{ alpha = 1.5707963267948966, d = 0.12, mass = 4.0 }},
    {{ alpha = -1.5707963267948966, d = 0.12, mass = 4.0 }},
    {{ alpha = 1.5707963267948966, d = 0.25, mass = 4.0 }},
]
[arm.limits]
rate = 0.3
acceleration = 0.25
torque = 60.0
range = [[-2.9, 2.9], [-2.9, 2.9], [-2.9, 2.9], [-2.9, 2.9], [-2.9, 2.9], [-2.9, 2.9]]
"""
_HALF = 0.7071067811865475
TWO_SIX = (
    """
name = "two_six"
[satellite]
mass = 500.0
size = 1.0
[target]
position = [0.0, 1.15, 0.0]
orientation = [1.0, 0.0, 0.0, 0.0]
[simulation]
timestep = 0.01
largest_control_period = 0.1
"""
    + _SIX_JOINT_ARM.format(x=0.5, y=_HALF, home=[1.09, -0.47, 1.8, 0.84, 0.0, 0.97])
    + _SIX_JOINT_ARM.format(x=-0.5, y=-_HALF, home=[1.09, -0.13, 1.1, -2.18, 0.0, -1.93])
)

DESCRIPTIONS = {
    "SpaceCapture/SingleArm-v0": SIX_JOINTS,
    "SpaceCapture/SingleArmCluttered-v0": SIX_JOINTS,
    "SpaceCapture/DualArmPlanar-v0": PLANAR_FOUR,
    "SpaceCapture/DualArmSpatial-v0": TWO_SIX,
}
