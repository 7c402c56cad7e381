"""Joints, constraints and actuators of a compiled MJCF model."""

import mujoco
import numpy as np

from space_envs.robots.description.importing.files.tree import HINGE, SLIDE, FileJoint

_KINDS = {
    int(mujoco.mjtJoint.mjJNT_HINGE): HINGE,
    int(mujoco.mjtJoint.mjJNT_SLIDE): SLIDE,
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
    int(mujoco.mjtJoint.mjJNT_FREE): "floating",
}


def joint_of(model: mujoco.MjModel, number: int) -> FileJoint:
    """A joint of a compiled model."""
    kind = _KINDS[int(model.jnt_type[number])]
    single = kind in (HINGE, SLIDE)
    low, high = (float(value) for value in model.jnt_range[number])
    limited = single and bool(model.jnt_limited[number])
    return FileJoint(
        name=joint_name(model, number),
        kind=kind,
        axis=np.array(model.jnt_axis[number]),
        at=np.array(model.jnt_pos[number]),
        zero=float(model.qpos0[model.jnt_qposadr[number]]) if single else 0.0,
        range=(low, high) if limited else None,
        effort=_effort(model, number) if single else None,
        endless=single and not limited,
        rotor_inertia=float(model.dof_armature[model.jnt_dofadr[number]]) if single else 0.0,
    )


def joint_name(model: mujoco.MjModel, number: int) -> str:
    """Name of a joint, or one made of its body's."""
    return model.joint(number).name or f"joint {number} of {model.body(int(model.jnt_bodyid[number])).name}"


def _effort(model: mujoco.MjModel, joint: int) -> float | None:
    """Largest torque of a joint: its own limit, or that of its motor, N m."""
    if model.jnt_actfrclimited[joint]:
        return float(np.abs(model.jnt_actfrcrange[joint]).max())
    for actuator in range(model.nu):
        on_joint = int(model.actuator_trntype[actuator]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        if not on_joint or int(model.actuator_trnid[actuator, 0]) != joint:
            continue
        gear = abs(float(model.actuator_gear[actuator, 0]))
        if model.actuator_forcelimited[actuator]:
            return gear * float(np.abs(model.actuator_forcerange[actuator]).max())
        motor = int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_NONE)
        if motor and model.actuator_ctrllimited[actuator]:
            gain = abs(float(model.actuator_gainprm[actuator, 0]))
            return gear * gain * float(np.abs(model.actuator_ctrlrange[actuator]).max())
    return None


def coupled(model: mujoco.MjModel) -> dict[str, str]:
    """Joints and bodies that active equality constraints couple, with the kind of each constraint."""
    found: dict[str, str] = {}
    for number in range(model.neq):
        if not model.eq_active0[number]:
            continue
        kind = mujoco.mjtEq(int(model.eq_type[number])).name.removeprefix("mjEQ_").lower()
        ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
        if kind == "joint":
            found |= {joint_name(model, end): kind for end in ends if end >= 0}
        elif kind in ("connect", "weld"):
            on_sites = int(model.eq_objtype[number]) == int(mujoco.mjtObj.mjOBJ_SITE)
            bodies = [int(model.site_bodyid[end]) if on_sites else end for end in ends]
            found |= {model.body(body).name: kind for body in bodies if body > 0}
    return found


def ignored(spec: mujoco.MjSpec, model: mujoco.MjModel) -> list[str]:
    """Sentences about what a model has and nothing here simulates."""
    hinges = [j for j in range(model.njnt) if _KINDS[int(model.jnt_type[j])] in (HINGE, SLIDE)]
    dofs = {joint_name(model, j): int(model.jnt_dofadr[j]) for j in hinges}
    fields = {"damping": model.dof_damping, "friction": model.dof_frictionloss}
    notes = []
    for word, values in fields.items():
        if names := [name for name, dof in dofs.items() if np.any(values[dof])]:
            notes.append(f"{word} of joints is not simulated: {', '.join(names)}.")
    if names := [joint_name(model, j) for j in hinges if np.any(model.jnt_stiffness[j])]:
        notes.append(f"stiffness of joints is not simulated: {', '.join(names)}.")
    if np.any(model.body_gravcomp):
        notes.append("gravity compensation is not simulated: there is no gravity.")
    if model.nu:
        notes.append(f"{model.nu} actuators of the file are not used: every joint has a motor of its own.")
    if np.any(model.eq_active0):
        notes.append("equality constraints, which couple no joint between root and tool, are not simulated.")
    if model.ntendon:
        notes.append("tendons are not simulated.")
    computed = [b.name for b in spec.bodies if b.name != "world" and not b.explicitinertial and b.geoms]
    if computed:
        notes.append(f"inertias computed from geometry by MuJoCo: {', '.join(computed)}.")
    return notes
