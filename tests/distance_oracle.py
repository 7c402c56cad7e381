"""MuJoCo's own distances between links and what they may not touch: no check of the project uses them."""

from typing import Any

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.dual_arm import DualArmOptions, dual_arm_spec
from space_envs.robots.parameters import DUAL_ARM_PLANAR, DUAL_ARM_SPATIAL, SINGLE_ARM
from space_envs.robots.single_arm import ModelOptions, single_arm_spec


class Oracle:
    """MuJoCo's own distances between capsules, boxes and spheres that are put up from the parameters."""

    def __init__(self, env_id: str) -> None:
        dual, planar, cluttered = "Dual" in env_id, "Planar" in env_id, "Cluttered" in env_id
        if dual:
            spec = dual_arm_spec(DualArmOptions("planar" if planar else "spatial"))
            parameters = DUAL_ARM_PLANAR if planar else DUAL_ARM_SPATIAL
            lengths = [(p.length, 0.0) for p in parameters.arm] if planar else None
            lengths = lengths or list(zip(parameters.a, parameters.d, strict=True))
        else:
            spec, parameters = (
                single_arm_spec(ModelOptions(obstacles=3 * cluttered)),
                SINGLE_ARM,
            )
            lengths = [(link.a, link.d) for link in parameters.links]
        radius, n = parameters.link_radius, len(lengths)
        kinds = ("satellite", "target", "arms", "obstacle")
        self.pairs: dict[str, list[tuple[str, str]]] = {kind: [] for kind in kinds}
        bodies: list[list[str]] = []
        for arm in (1, 2) if dual else (1,):
            bodies.append([])
            for number, (a, d) in enumerate(lengths, start=1):
                body = f"arm{arm}_link{number}" if dual else f"link{number}"
                end = np.array([a, 0.0, d])
                length = float(np.linalg.norm(end))
                if length == 0.0:
                    continue

                def add(
                    part: str, begin: float, stop: float, size: float, on: str = body, at: Array = end
                ) -> str:
                    geom = spec.body(on).add_geom(name=f"{on}_{part}", mass=0.0)
                    geom.type, geom.size[0] = mujoco.mjtGeom.mjGEOM_CAPSULE, size
                    geom.fromto = [*(begin * at), *(stop * at)]
                    return f"{on}_{part}"

                whole = add("whole", 0.0, 1.0, radius)
                bodies[-1].append(whole)
                if not planar and number > (1 if dual else 3):
                    self.pairs["satellite"].append((whole, "bus"))
                if not dual and number == 3:  # by its centre line, from where it leaves the deck
                    self.pairs["satellite"].append((add("line", radius / length, 1.0, 1e-6), "bus"))
                if dual and number < n:
                    self.pairs["target"].append((whole, "box"))
                if dual and number == n:
                    grip = 1.0 - 0.15 / length
                    self.pairs["target"].append((add("main", 0.0, grip, radius), "box"))
                    self.pairs["target"].append((add("line", grip, 1.0, 1e-6), "box"))
        if dual:
            self.pairs["arms"] = [(one, other) for one in bodies[0] for other in bodies[1]]
        if not planar:
            bus = spec.body("satellite").add_geom(name="bus", mass=0.0)
            bus.type, bus.size = mujoco.mjtGeom.mjGEOM_BOX, np.full(3, 0.5 * parameters.satellite_side)
        if dual:
            box = spec.body("target").add_geom(name="box", mass=0.0)
            box.type, box.size = mujoco.mjtGeom.mjGEOM_BOX, np.array(parameters.target.body)
            self.nominal = parameters.target
        if cluttered:
            for number in range(3):
                ball = spec.worldbody.add_geom(name=f"ball{number}", mass=0.0)
                ball.type, ball.size[0] = mujoco.mjtGeom.mjGEOM_SPHERE, 0.1
                ball.pos = [9.0, 9.0, 9.0]  # one in its frame's origin would never be moved
                self.pairs["obstacle"] += [(link, f"ball{number}") for link in bodies[0]]
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def gaps(self, qpos: Array, goals: Any, row: int) -> dict[str, float]:
        """Least gap of each kind, m, in a state (nq,) of an episode to a row's goal."""
        model, data = self.model, self.data
        data.qpos[:] = qpos
        if self.pairs["target"]:
            size = np.array(self.nominal.body) * goals.half_width[row] / self.nominal.half_width
            model.geom("box").size = size
        for number in range(3 if self.pairs["obstacle"] else 0):
            ball = model.geom(f"ball{number}")
            ball.pos, ball.size[0] = goals.obstacle_position[row, number], goals.obstacle_radius[row, number]
        mujoco.mj_kinematics(model, data)
        least = {}
        for kind, pairs in self.pairs.items():
            ids = [(model.geom(one).id, model.geom(other).id) for one, other in pairs]
            distances = [mujoco.mj_geomDistance(model, data, *pair, 5.0, None) for pair in ids]
            least[kind] = min(distances, default=np.inf)
        return least
