"""Motions as actions: one action is the ProMP weights of a whole joint motion.

Importing the package registers an id for every task with static goals: `SpaceCaptureMotions/SingleArm-v0` is
`SpaceCapture/SingleArm-v0` with motions as actions.
"""

import gymnasium as gym

NAMESPACE = "SpaceCaptureMotions"
TASKS = ("SingleArm-v0", "SingleArmCluttered-v0")

for _task in TASKS:
    gym.register(
        id=f"{NAMESPACE}/{_task}",
        entry_point="agents.motions.single:make_motion",
        vector_entry_point="agents.motions.making:make_motions",
        kwargs={"env_id": f"SpaceCapture/{_task}"},
    )
