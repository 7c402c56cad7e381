"""Robots and states that the dynamics tests share, and what MuJoCo says about them."""

from copy import copy
from functools import cache

import mujoco
import numpy as np

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.robots.models import robot_model
from space_envs.robots.zoo import find_robot

ROBOTS = ("single arm", "random tree")
TIMESTEP = 0.005  # s


@cache
def robot_and_model(name: str) -> tuple[FloatingRobot, mujoco.MjModel]:
    """The project's arm, without rotors or with, or a tree with two arms that branch and random axes."""
    if name in ("single arm", "arm with rotors"):
        model = robot_model(find_robot("shyam2020", "paper" if name == "single arm" else "physical"))
        return FloatingRobot.from_model(model), model
    model = random_tree(np.random.default_rng(20))
    return FloatingRobot.from_model(model, "bus", ("left", "right")), model


def random_tree(rng: np.random.Generator, parents: tuple[int, ...] = (0, 1, 2, 0, 4, 4)) -> mujoco.MjModel:
    """Compile a free base `bus` with hinged links; end-effectors `left` on link 3, `right` on the last."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_body(name="bystander", mocap=True)  # so that body numbers are not the robot's
    bodies = [spec.worldbody.add_body(name="bus", explicitinertial=True)]
    bodies[0].add_freejoint()
    for number, parent in enumerate(parents, start=1):
        body = bodies[parent].add_body(
            name=f"link{number}", pos=rng.normal(size=3), quat=unit(rng.normal(size=4)), explicitinertial=True
        )
        joint = body.add_joint(
            name=f"joint{number}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=unit(rng.normal(size=3))
        )
        if number == 1:
            joint.range = [-9.0, 8.0]
        spec.add_actuator(
            name=f"joint{number}", target=f"joint{number}", trntype=mujoco.mjtTrn.mjTRN_JOINT
        ).set_to_motor()
        bodies.append(body)
    for body in bodies:
        body.mass = rng.uniform(1.0, 5.0) * (20.0 if body is bodies[0] else 1.0)
        body.ipos = 0.3 * rng.normal(size=3)
        body.iquat = unit(rng.normal(size=4))
        body.inertia = body.mass * rng.uniform(
            0.6, 1.0, size=3
        )  # any such triple meets the triangle inequality
    for name, body in (("left", bodies[3]), ("right", bodies[-1])):
        body.add_site(name=name, pos=rng.normal(size=3), quat=unit(rng.normal(size=4)))
    home = rng.uniform(-1.0, 1.0, len(parents))
    spec.add_key(name="home", qpos=[0, 0, 0, 1, 0, 0, 0, *home])
    return spec.compile()


def straight_arm() -> mujoco.MjModel:
    """Two links in a tilted plane; at joint angles zero everything lies on one line, away from the base."""
    return mujoco.MjModel.from_xml_string("""
    <mujoco>
      <compiler angle="radian" balanceinertia="false"/>
      <option gravity="0 0 0" integrator="RK4"/>
      <worldbody>
        <body name="satellite">
          <freejoint/>
          <inertial pos="-0.1 0 0" mass="10" diaginertia="2 2 2"/>
          <body name="upper" pos="0.5 0 0" quat="0.8 0.6 0 0">
            <joint axis="0 0 1"/>
            <inertial pos="0.4 0 0" mass="3" diaginertia="0.1 0.5 0.5"/>
            <body name="lower" pos="1 0 0">
              <joint axis="0 0 1"/>
              <inertial pos="0.3 0 0" mass="2" diaginertia="0.1 0.3 0.3"/>
              <site name="end_effector" pos="0.8 0 0"/>
            </body>
          </body>
        </body>
      </worldbody>
      <keyframe><key name="home" qpos="0 0 0 1 0 0 0 0 0"/></keyframe>
    </mujoco>
    """)


def unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def random_state(rng: np.random.Generator, n: int) -> dict[str, Array]:
    """q, qdot (n), pose and twist [v; w] in base axes of the base."""
    return {
        "q": rng.uniform(-np.pi, np.pi, n),
        "qdot": rng.normal(size=n),
        "position": rng.normal(size=3),
        "quaternion": unit(rng.normal(size=4)),
        "twist": rng.normal(size=6),
    }


def matrix(quaternion: Array) -> Array:
    """Rotation matrix, by MuJoCo."""
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def data_at(model: mujoco.MjModel, state: dict[str, Array]) -> mujoco.MjData:
    """MuJoCo data in a state. A free joint's velocity is linear in world axes and angular in body axes."""
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate([state["position"], state["quaternion"], state["q"]])
    turned = matrix(state["quaternion"]) @ state["twist"][:3]
    data.qvel[:] = np.concatenate([turned, state["twist"][3:], state["qdot"]])
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return data


def mass_in_base_axes(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """MuJoCo's mass matrix for velocities [v; w; qdot] with v in base axes."""
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    to_world = np.eye(model.nv)
    to_world[:3, :3] = matrix(data.qpos[3:7])
    return to_world.T @ mass @ to_world


def jacobian_in_base_axes(model: mujoco.MjModel, data: mujoco.MjData, site: str) -> Array:
    """MuJoCo's Jacobian (6, 6 + n) of a site, of [v; w; qdot] with all vectors in base axes."""
    linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
    mujoco.mj_jacSite(model, data, linear, angular, model.site(site).id)
    turned = matrix(data.qpos[3:7])
    jacobian = np.concatenate([turned.T @ linear, turned.T @ angular])
    jacobian[:, :3] = jacobian[:, :3] @ turned
    return jacobian


def simulate(
    model: mujoco.MjModel, state: dict[str, Array], rng: np.random.Generator, torque: float
) -> dict[str, Array]:
    """Run 4 s of MuJoCo in steps of 5 ms under smooth random torques; record joints, base pose, momentum."""
    model = copy(model)
    model.opt.timestep = TIMESTEP
    data = data_at(model, state)
    amplitude, rate, phase = (
        rng.uniform(*bounds, model.nu) for bounds in ((0.3, 1.0), (0.5, 1.5), (0.0, 6.0))
    )
    rows: dict[str, list[Array]] = {key: [] for key in ("q", "qdot", "position", "quaternion", "momentum")}
    for step in range(801):
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        root = int(model.jnt_bodyid[0])
        total = model.body_subtreemass[root] * data.subtree_linvel[root]
        angular = data.subtree_angmom[root] + np.cross(data.subtree_com[root], total)
        rows["q"].append(data.qpos[7:].copy())
        rows["qdot"].append(data.qvel[6:].copy())
        rows["position"].append(data.qpos[:3].copy())
        rows["quaternion"].append(data.qpos[3:7].copy())
        rows["momentum"].append(np.concatenate([total, angular]))
        data.ctrl[:] = torque * amplitude * np.sin(rate * step * TIMESTEP + phase)
        mujoco.mj_step(model, data)
    return {key: np.array(value) for key, value in rows.items()}
