"""MuJoCo's own distances between links and what they may not touch: no check of the project uses them."""

from typing import Any

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.models import SceneOptions, robot_spec
from space_envs.robots.zoo import find_robot

# m: radius of the links, half sides of the satellite and of the target, and the nominal half width of that.
RADIUS = {"single": 0.08, "planar": 0.05, "spatial": 0.05}
BUS = np.full(3, 0.5)
TARGET = {"planar": (0.16, 0.18, 0.16), "spatial": (0.18, 0.24, 0.22)}
HALF_WIDTH = 0.3
ROBOTS = {"single": "shyam2020", "planar": "shah2013", "spatial": "spatial_dual_arm"}


class Oracle:
    """MuJoCo's own distances between capsules, boxes and spheres that are put up from the parameters."""

    def __init__(self, env_id: str) -> None:
        dual, planar, cluttered = "Dual" in env_id, "Planar" in env_id, "Cluttered" in env_id
        name = "planar" if planar else "spatial" if dual else "single"
        robot, radius = find_robot(ROBOTS[name]), RADIUS[name]
        spec = robot_spec(robot, SceneOptions(obstacles=3 * cluttered))
        ends = [*(link.position for link in robot.arms[0].links[1:]), robot.arms[0].tool_position]
        n = len(ends)
        kinds = ("satellite", "target", "arms", "obstacle")
        self.pairs: dict[str, list[tuple[str, str]]] = {kind: [] for kind in kinds}
        bodies: list[list[str]] = []
        for arm in (1, 2) if dual else (1,):
            bodies.append([])
            for number, end in enumerate(map(np.array, ends), start=1):
                body = f"arm{arm}_link{number}" if dual else f"link{number}"
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
            bus.type, bus.size = mujoco.mjtGeom.mjGEOM_BOX, BUS
        if dual:
            box = spec.body("target").add_geom(name="box", mass=0.0)
            box.type, box.size = mujoco.mjtGeom.mjGEOM_BOX, np.array(TARGET[name])
            self.target = np.array(TARGET[name])
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
            model.geom("box").size = self.target * goals.half_width[row] / HALF_WIDTH
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
