"""Draw the README's pictures: `python -m docs.pictures` runs an episode for each and writes docs/images.

It needs OpenGL, as `render_mode="rgb_array"` does.
"""

import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from agents.policies.resolve import resolve_policy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import SpaceEnvsError
from space_envs.evaluation.play.steps import steps
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser
from space_envs.system.files import atomic_write

IMAGES = Path(__file__).resolve().parent / "images"
WIDTH, HEIGHT = 1280, 640
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(prog="python -m docs.pictures", description=__doc__)
    parser.add_argument(
        "--output", type=Path, default=IMAGES, help="folder to write to (default: docs/images)"
    )
    options = parser.parse_args(arguments)
    for shot in SHOTS:
        content = io.BytesIO()
        try:
            Image.fromarray(draw(shot)).save(content, format="JPEG", quality=QUALITY)
        except SpaceEnvsError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        with atomic_write(options.output / f"{shot.name}.jpg") as temporary:
            temporary.write_bytes(content.getvalue())
        print(options.output / f"{shot.name}.jpg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
