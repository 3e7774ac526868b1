"""Torque of a held-out motion by mujoco.sysid, run by its own Python: `python mujoco_torque.py`.

Each line on standard input names a folder with job.npz and robot.urdf; predicted.npy is written there. mujoco.sysid
fits by Gauss-Newton all inertial parameters of each body (pseudo-inertia, within its bounds about the description),
armature, damping, frictionloss and a bias of each torque. The controller of a real robot is unknown, so nothing is
simulated: residuals are recorded torque minus mj_inverse along the recorded motion.
"""

from __future__ import annotations

import logging
import sys
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from answers import answer_each  # next to this file, which runs as a script
from mujoco import sysid

KEYS = ("armature", "damping", "frictionloss")
STIFF = (0.9999, 0.9999, 0.001, 0.5, 2)  # solimp of stiff dry friction, as in benchmarks.plants
STEP, SAMPLES, ITERATIONS = 1e-3, 800, 30  # time step [s], evenly spaced samples of the fit, most Gauss-Newton steps
SIZE = {
    "armature": 0.1,
    "damping": 0.5,
    "frictionloss": 0.5,
    "bias": 0.2,
}  # initial values over rms torque / rms motion [1]
LIGHT = 1e-2, 1e-5  # least mass [kg] and inertia [kg.m2] of a body; MuJoCo requires positive ones
MOST, LEAST = 20.0, 1e-4  # bounds over the initial value [1]


def build(urdf: str, joints: list[str]) -> Any:
    """Build the arm without joint limits and with stiff dry friction."""
    spec = mujoco.MjSpec.from_string(urdf)
    spec.option.timestep = STEP
    spec.compiler.boundmass, spec.compiler.boundinertia = LIGHT
    for name in joints:
        joint = spec.joint(name)
        joint.solref_friction, joint.solimp_friction = [2 * STEP, 1], list(STIFF)
        joint.limited = joint.actfrclimited = 0
    return spec


def assign(key: str, joint: str) -> Any:
    """Return a function that writes a parameter into the specification; damping is a polynomial there."""

    def write(spec: Any, parameter: Any) -> None:
        at, value = spec.joint(joint), float(parameter.value[0])
        if key == "damping":
            at.damping[0] = value
        else:
            setattr(at, key, value)

    return write


def assign_inertia(body: str) -> Any:
    """Return a function that writes a pseudo-inertia and resets iquat, which mujoco.sysid 4.0.0 sets to NaN."""

    def write(spec: Any, parameter: Any) -> None:
        sysid.apply_body_inertia(spec, body, parameter)
        spec.body(body).iquat = [1, 0, 0, 0]

    return write


def parameters(spec: Any, model: Any, joints: list[str], rows: dict[str, Any]) -> Any:
    """Ten parameters per moving body and four per joint, with initial values in proportion to the joint's torque."""
    found = sysid.ParameterDict()
    for i, name in enumerate(joints):
        body = spec.joint(name).parent.name
        write = assign_inertia(body)
        found.add(sysid.body_inertia_param(spec, model, body, sysid.InertiaType.Pseudo, modifier=write))
        torque, v, a = (float(np.sqrt(np.mean(rows[key][:, i] ** 2))) for key in ("tau", "v", "a"))
        for key, motion in zip(KEYS, (a, v, 1.0), strict=True):
            size = SIZE[key] * torque / max(motion, 1e-9)
            one = sysid.Parameter(f"{name}_{key}", size, LEAST * size, MOST * size, modifier=assign(key, name))
            found.add(one)
        found.add(sysid.Parameter(f"{name}_bias", 0.0, -MOST * SIZE["bias"] * torque, MOST * SIZE["bias"] * torque))
    return found


def torque(model: Any, places: Any, q: Any, v: Any, a: Any) -> Any:
    """Motor torque (N, n) [N.m or N] along a motion."""
    data, out = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[places], data.qvel[places], data.qacc[places] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse[places]
    return out


def predict(folder: Path) -> dict[str, Any]:
    """Run one job."""
    job = dict(np.load(folder / "job.npz"))
    joints = job["joints"].tolist()
    start = time.process_time()
    spec = build((folder / "robot.urdf").read_text(encoding="utf-8"), joints)
    model = spec.compile()
    if model.nv != len(joints):
        raise ValueError(f"MuJoCo reads {model.nv} joints instead of {len(joints)} from the description")
    places = np.array([model.joint(name).dofadr[0] for name in joints])
    some = np.linspace(0, len(job["row_q"]) - 1, min(SAMPLES, len(job["row_q"]))).astype(int)
    rows = {key: job[f"row_{key}"][some] for key in ("q", "v", "a", "tau")}
    size = np.sqrt(np.mean(rows["tau"] ** 2, axis=0))

    def predicted(params: Any, q: Any, v: Any, a: Any) -> Any:
        bias = [float(params[f"{name}_bias"].value[0]) for name in joints]
        return torque(sysid.apply_param_modifiers(params, spec), places, q, v, a) + bias

    def residual(x: Any, params: Any) -> Any:
        columns = []
        for column in np.reshape(x, (params.size, -1)).T:
            params.update_from_vector(column)
            columns.append(((predicted(params, *(rows[k] for k in "qva")) - rows["tau"]) / size).ravel())
        return [np.reshape(np.column_stack(columns), (-1, *np.shape(x)[1:]))], None, None

    initial = parameters(spec, model, joints, rows)
    found = sysid.optimize(initial, residual, optimizer="mujoco", verbose=False, max_iters=ITERATIONS)[0]
    seconds = time.process_time() - start
    np.save(folder / "predicted.npy", predicted(found, *(job[f"held_out_{key}"] for key in "qva")))
    return {"seconds": seconds, "note": f"{found.size} parameters, {len(some)} rows"}


def main() -> None:
    """Answer until the input ends."""
    logging.disable(logging.WARNING)
    if not hasattr(sysid, "ParameterDict"):
        sys.exit("mujoco.sysid lacks its dependencies; run pip install 'mujoco[sysid]'")
    answer_each("mujoco", predict)


if __name__ == "__main__":
    main()
