"""Draw the pictures of the README and of docs/robots.md: `python -m docs.pictures` writes docs/images.

Those of the README are of episodes, those of the robots show each one at home, and all of them side by side.
It needs OpenGL, as `render_mode="rgb_array"` does.
"""

import io
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from agents.policies.resolve import resolve_policy
from docs.zoo import zoo
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import SpaceEnvsError
from space_envs.evaluation.play.steps import steps
from space_envs.policy import PolicyContext
from space_envs.rendering import Renderer
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.zoo import find_robot
from space_envs.system.command_line import Parser
from space_envs.system.files import atomic_write

IMAGES = Path(__file__).resolve().parent / "images"
WIDTH, HEIGHT = 1280, 640
ROBOT_WIDTH, ROBOT_HEIGHT = 640, 480
COLUMNS = 3  # of the robots side by side
QUALITY = 88


@dataclass(frozen=True)
class Shot:
    """A picture of an episode of a policy at a given time, on a goal of the test split.

    Attributes:
        name: of the file, without its suffix. env_id: registered id. policy: built-in policy.
        index: of the goal. seconds: simulated time at which to draw, or at the end of a shorter episode.
        camera: of the model.
    """

    name: str
    env_id: str
    policy: str
    index: int
    seconds: float
    camera: str = "overview"


SHOTS = (
    Shot("capture", "SpaceCapture/SingleArm-v0", "gjm", 1, 4.0),
    Shot("dual_arm_planar", "SpaceCapture/DualArmPlanar-v0", "reactionless_rate", 9, 30.0),
    Shot("dual_arm_spatial", "SpaceCapture/DualArmSpatial-v0", "reactionless_rate", 8, 30.0),
)


def draw(shot: Shot, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """Picture (height, width, 3) of an episode at the time of a shot.

    Raises:
        SpaceEnvsError: if the policy fails, or nothing can be drawn here.
    """
    resolved = resolve_policy(shot.policy)
    env = CaptureVectorEnv(
        env_id=shot.env_id,
        autoreset_mode="disabled",
        render_mode="rgb_array",
        width=width,
        height=height,
        camera=shot.camera,
        control_mode=resolved.control_mode,
    )
    policy = resolved.build(PolicyContext.from_env(env), 0)
    observation, _ = env.reset(options={"split": "test", "index": shot.index})
    for _ in islice(steps(policy, env, observation), round(shot.seconds / env.task.control_period)):
        pass
    picture = env.render()
    env.close()
    return np.asarray(picture, dtype=np.uint8)[0]


def draw_robot(name: str, width: int = ROBOT_WIDTH, height: int = ROBOT_HEIGHT) -> NDArray[np.uint8]:
    """Picture (height, width, 3) of a robot at home.

    Raises:
        SpaceEnvsError: if there is no such robot, or nothing can be drawn here.
    """
    model = robot_model(find_robot(name), SceneOptions(visual=True))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    with Renderer(model, width=width, height=height) as renderer:
        return renderer.render(state)


def side_by_side(pictures: Sequence[NDArray[np.uint8]], columns: int = COLUMNS) -> NDArray[np.uint8]:
    """Pictures of one size in rows; the last row is filled up in black."""
    blank = np.zeros_like(pictures[0])
    filled = [*pictures, *[blank] * (-len(pictures) % columns)]
    rows = [np.concatenate(filled[i : i + columns], axis=1) for i in range(0, len(filled), columns)]
    return np.concatenate(rows)


def drawn() -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """File names without suffix, relative to docs/images, and pictures."""
    for shot in SHOTS:
        yield shot.name, draw(shot)
    robots = {name: draw_robot(name) for name in zoo()}
    for name, picture in robots.items():
        yield f"robots/{name}", picture
    yield "robots", side_by_side([picture[::2, ::2] for picture in robots.values()])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(prog="python -m docs.pictures", description=__doc__)
    parser.add_argument(
        "--output", type=Path, default=IMAGES, help="folder to write to (default: docs/images)"
    )
    options = parser.parse_args(arguments)
    try:
        for name, picture in drawn():
            content = io.BytesIO()
            Image.fromarray(picture).save(content, format="JPEG", quality=QUALITY)
            with atomic_write(options.output / f"{name}.jpg") as temporary:
                temporary.write_bytes(content.getvalue())
            print(options.output / f"{name}.jpg")
    except SpaceEnvsError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
