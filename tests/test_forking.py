"""What a forked child does with an environment that its parent made: it goes on there, and never hangs."""

import json
import subprocess
import sys

from offenders import assert_none

from space_envs.rendering import missing_gl

# Each child does one thing with what it got. An alarm ends those that hang.
SCRIPT = """
import copy, gc, json, multiprocessing, os, pickle, signal, sys, threading, time
import gymnasium as gym, numpy as np
import space_envs
from space_envs.errors import RenderingError

THREADS, GL, STEPS = 3, sys.argv[1] == "gl", 5
ID = "SpaceCapture/SingleArm-v0"
picture = {"render_mode": "rgb_array", "width": 32, "height": 24} if GL else {}
make = lambda mode, **more: gym.make_vec(
    ID, num_envs=4, threads=THREADS, control_mode=mode, split="ood", **more
)
actions = np.random.default_rng(0).uniform(-1, 1, (2 * STEPS, 4, 7))
envs = {mode: make(mode) for mode in ("joint_velocity", "end_effector_velocity")}
envs["drawn"] = make("joint_velocity", **picture)
tool = envs["end_effector_velocity"].action_space.shape[1]
for env in envs.values():
    env.reset(seed=0)
    for action in actions[:STEPS]:
        env.step(action[:, : env.action_space.shape[1]])
if GL:
    envs["drawn"].render()

def played(env):
    seen = [env.step(a[:, : env.action_space.shape[1]])[0].tolist() for a in actions[STEPS:]]
    return [*seen, env.reset()[0].tolist()]

def in_child(task):
    receive, send = os.pipe()
    pid = os.fork()
    if not pid:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(12)
        os.close(receive)
        status = 0
        try:
            said = task()
        except SystemExit:
            os.write(send, b"null")
            raise
        except BaseException as error:
            said, status = f"{type(error).__name__}: {error}", 3
        os.write(send, json.dumps(said).encode())
        os.close(send)
        os._exit(status)
    os.close(send)
    with os.fdopen(receive) as pipe:
        said = pipe.read()
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return [status, json.loads(said) if said else None]

def drop():
    envs.clear()
    gc.collect()

def leave():
    sys.exit(0)

def use_and_leave():
    played(envs["joint_velocity"])
    sys.exit(0)

def refused_or_drawn():
    try:
        return [picture.tolist() for picture in envs["drawn"].render()]
    except RenderingError as error:
        return f"RenderingError: {error}"

def closed():
    for env in envs.values():
        env.close()
    drop()

def of_single():
    return single.step(np.full(7, 0.2))[0].tolist()

def grandchild():
    return in_child(lambda: played(envs["joint_velocity"]))[1]

def pool():
    with multiprocessing.get_context("fork").Pool(2) as workers:
        return workers.map(step_in_worker, [0.1, 0.2])

def step_in_worker(value):
    env = envs["joint_velocity"]
    env.reset(seed=3)  # a worker may have more than one turn
    return env.step(np.full((4, 7), value))[0].tolist()

def pool_of_parent():
    return [step_in_worker(value) for value in (0.1, 0.2)]

single = gym.make(ID)
single.reset(seed=1)
single.step(np.full(7, 0.1))
found = {
    name: in_child(task)
    for name, task in {
        "nothing": lambda: None,
        "step": lambda: played(envs["joint_velocity"]),
        "step_tool": lambda: played(envs["end_effector_velocity"]),
        "reset": lambda: envs["joint_velocity"].reset(seed=3)[0].tolist(),
        "pickle": lambda: played(pickle.loads(pickle.dumps(envs["joint_velocity"]))),
        "deepcopy": lambda: played(copy.deepcopy(envs["joint_velocity"])),
        "drop": drop,
        "close": closed,
        "exit": leave,
        "use_and_exit": use_and_leave,
        "single": of_single,
        "grandchild": grandchild,
        "render": refused_or_drawn,
        "new": lambda: make("joint_velocity").reset(seed=0)[0].tolist(),
    }.items()
}
found["pool"] = [0, pool()]

# A thread that steps while the process is forked, and is the only one to know its environment.
going = threading.Event()
def other():
    env = make("joint_velocity")
    env.reset(seed=0)
    while not going.is_set():
        env.step(np.zeros((4, 7)))
thread = threading.Thread(target=other)
thread.start()
time.sleep(0.3)
found["beside_a_thread"] = [in_child(drop)[0] for _ in range(4)]
found["exit_beside_a_thread"] = [in_child(leave)[0] for _ in range(4)]
going.set()
thread.join()

# What the parent gets, after all of it.
expected = {
    "single": of_single(),
    "reset": copy.deepcopy(envs["joint_velocity"]).reset(seed=3)[0].tolist(),
    "new": make("joint_velocity").reset(seed=0)[0].tolist(),
    "step_tool": played(envs["end_effector_velocity"]),
    "step": played(envs["joint_velocity"]),
    "pool": pool_of_parent(),
}
json.dump([found, expected], sys.stdout)
"""
AS_STEP = ("pickle", "deepcopy", "grandchild")
GOING_ON = ("step", "step_tool", "reset", *AS_STEP, "single", "new", "pool")
ENDING = ("nothing", "drop", "close", "exit", "use_and_exit")


def test_forked_children_go_on_as_their_parent_would_or_end_and_never_hang() -> None:
    missing = missing_gl()
    words = [sys.executable, "-c", SCRIPT, "gl" if missing is None else "no gl"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found, expected = json.loads(done.stdout)
    expected |= {name: expected["step"] for name in AS_STEP} | dict.fromkeys(ENDING)
    assert_none(
        f"{name}: {found[name]}" for name in (*GOING_ON, *ENDING) if found[name] != [0, expected[name]]
    )
    # A child does not draw with the OpenGL of its parent.
    status, said = found["render"]
    assert status == 0
    if missing is None:
        assert "RenderingError" in said and "forked" in said and "spawn" in said
    else:
        assert said is None
    # Beside a thread that steps.
    assert found["beside_a_thread"] == found["exit_beside_a_thread"] == [0] * 4


LOADER = """
import gymnasium as gym, numpy as np, torch
import space_envs
from torch.utils.data import DataLoader, Dataset

class Steps(Dataset):
    def __init__(self):
        self.env = gym.make_vec("SpaceCapture/SingleArm-v0", num_envs=4, threads=2)
        self.env.reset(seed=0)
    def __len__(self):
        return 4
    def __getitem__(self, item):
        self.env.reset(seed=item)
        return self.env.step(np.full((4, 7), 0.3))[0]

data = Steps()
loader = DataLoader(data, batch_size=1, num_workers=2, multiprocessing_context="fork", timeout=20)
for item, batch in enumerate(loader):
    np.testing.assert_array_equal(batch[0].numpy(), data[item])
print("done")
"""


def test_workers_of_a_torch_data_loader_step() -> None:
    done = subprocess.run([sys.executable, "-c", LOADER], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "done"
