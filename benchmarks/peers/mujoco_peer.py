"""mujoco.sysid, run by its own Python: `python mujoco_peer.py sysid` or `python mujoco_peer.py torque`.

Each line on standard input names a folder with job.npz and robot.urdf; the answer is a line of JSON.

sysid: rotors and friction as in the README of mujoco.sysid: parameters with modifiers on the MjSpec, control loop with
commands, Gauss-Newton on all sensors, intervals, automated insights of the report. Everything except the fault is
known: bodies, controller, time step and solver settings of the plant, which is MuJoCo too. The fit starts at the true
rotors and friction.

torque: all inertial parameters of each body (pseudo-inertia, within its bounds about the description), armature,
damping, frictionloss and a bias of each torque by Gauss-Newton; the torque of a held-out motion is written to
predicted.npy. The controller of a real robot is unknown, so nothing is simulated: residuals are recorded torque minus
mj_inverse along the recorded motion.
"""

from __future__ import annotations

import logging
import re
import sys
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from answers import answer_each  # next to this file, which runs as a script
from mujoco import sysid
from mujoco.sysid.report.sections.insights import AutomatedInsights

KEYS = ("armature", "damping", "frictionloss")
STIFF = (0.9999, 0.9999, 0.001, 0.5, 2)  # solimp of stiff dry friction, as in benchmarks.plants
LOW, HIGH, ITERATIONS = 0.05, 5.0, 60  # bounds over the true values [1], most Gauss-Newton steps


def assign(key: str, joint: str) -> Any:
    """Return a function that writes a parameter into the specification; damping is a polynomial there."""

    def write(spec: Any, parameter: Any) -> None:
        at, value = spec.joint(joint), float(parameter.value[0])
        if key == "damping":
            at.damping[0] = value
        else:
            setattr(at, key, value)

    return write


def build(job: dict[str, Any], urdf: str) -> Any:
    """Build the arm with control loop and sensors of positions and torques."""
    spec = mujoco.MjSpec.from_string(urdf)
    step = float(job["step"])
    spec.option.timestep, spec.option.integrator = step, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.iterations, spec.option.tolerance = 50, 1e-12
    for i, name in enumerate(job["joints"].tolist()):
        joint = spec.joint(name)
        joint.armature, joint.damping[0], joint.frictionloss = (float(job[key][i]) for key in KEYS)
        joint.solref_friction, joint.solimp_friction = [2 * step, 1], list(STIFF)
        joint.limited = joint.actfrclimited = 0
        motor = spec.add_actuator(name=f"motor_{i + 1}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0], motor.biastype = 1, mujoco.mjtBias.mjBIAS_AFFINE
        motor.biasprm[:3] = 0, -job["loop_stiffness"][i], -job["loop_damper"][i]
        kind = mujoco.mjtSensor
        spec.add_sensor(name=f"q_{i + 1}", type=kind.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name)
        drive = {"objtype": mujoco.mjtObj.mjOBJ_ACTUATOR, "objname": motor.name}
        spec.add_sensor(name=f"tau_{i + 1}", type=kind.mjSENS_ACTUATORFRC, **drive)
    return spec


def parameters(job: dict[str, Any]) -> Any:
    """Three bounded parameters per joint, starting at the true values."""
    found = sysid.ParameterDict()
    for i, joint in enumerate(job["joints"].tolist()):
        for key in KEYS:
            true = float(job[key][i])
            write = assign(key, joint)
            found.add(sysid.Parameter(f"{joint}_{key}", true, LOW * true, HIGH * true, modifier=write))
    return found


def driving(job: dict[str, Any]) -> Any:
    """Residual of the torque of each step; the sensor uses the velocity before the step, the loop that after it."""
    transform, n = sysid.SignalTransform(), len(job["joints"])

    def residual(params: Any, own: Any, seen: Any, model: Any, whole: bool, state: Any = None, **rest: Any) -> Any:
        data, v = own.data.copy(), np.vstack([job["loop_v"], state[:, 1 + n : 1 + 2 * n]])
        data[:, 1::2] -= job["loop_damper"] * np.diff(v, axis=0)
        corrected = sysid.TimeSeries(own.times, data, own.signal_mapping)
        return transform.apply(params, corrected, seen, model, whole, **rest)

    return residual


def fit(folder: Path) -> dict[str, Any]:
    """Run one job."""
    job = dict(np.load(folder / "job.npz"))
    start = time.process_time()
    spec = build(job, (folder / "robot.urdf").read_text(encoding="utf-8"))
    model, params = spec.compile(), parameters(job)
    truth, step = params.as_vector(), float(job["step"])
    first = sysid.create_initial_state(model, job["loop_q"], job["loop_v"], np.zeros(0))
    control = sysid.TimeSeries(np.arange(len(job["loop_command"])) * step, job["loop_command"])
    rows = job["t"] < control.times[-1]
    seen = np.stack([job["q"], job["tau"]], axis=2)[rows].reshape(np.count_nonzero(rows), -1)
    sensors = sysid.TimeSeries.from_names(
        job["t"][rows] + step, seen, model
    )  # time of a step's end, like MuJoCo's sensors
    data = sysid.ModelSequences("arm", spec, "motion", first, control, sensors)
    residual = sysid.build_residual_fn(models_sequences=[data], modify_residual=driving(job), n_threads=1)
    found, result = sysid.optimize(params, residual, optimizer="mujoco", verbose=False, max_iters=ITERATIONS)
    x = found.as_vector()
    rest = residual(x, found)[0]
    half = sysid.calculate_intervals(rest, result.jac)[1]
    seconds = time.process_time() - start
    error = np.abs(x / truth - 1).reshape(-1, len(KEYS))
    insights = [re.sub("<.*?>", "", one["message"]) for one in AutomatedInsights("x", found).get_context()["insights"]]
    return {
        "cost": float(0.5 * np.sum(np.concatenate([r.ravel() for r in rest]) ** 2)),
        "errors": dict(zip(KEYS, error.max(axis=0).tolist(), strict=True)),
        "coverage": float(np.mean(np.abs(x - truth) <= half)),
        "insights": insights,
        "seconds": seconds,
    }


STEP, SAMPLES, FREE_ITERATIONS = 1e-3, 800, 30  # time step [s], samples of the fit, most Gauss-Newton steps
# initial values over rms torque / rms motion [1]
SIZE = {"armature": 0.1, "damping": 0.5, "frictionloss": 0.5, "bias": 0.2}
LIGHT = 1e-2, 1e-5  # least mass [kg] and inertia [kg.m2] of a body; MuJoCo requires positive ones
MOST, LEAST = 20.0, 1e-4  # bounds over the initial value [1]


def build_free(urdf: str, joints: list[str]) -> Any:
    """Build the arm without joint limits and with stiff dry friction."""
    spec = mujoco.MjSpec.from_string(urdf)
    spec.option.timestep = STEP
    spec.compiler.boundmass, spec.compiler.boundinertia = LIGHT
    for name in joints:
        joint = spec.joint(name)
        joint.solref_friction, joint.solimp_friction = [2 * STEP, 1], list(STIFF)
        joint.limited = joint.actfrclimited = 0
    return spec


def assign_inertia(body: str) -> Any:
    """Return a function that writes a pseudo-inertia and resets iquat, which mujoco.sysid 4.0.0 sets to NaN."""

    def write(spec: Any, parameter: Any) -> None:
        sysid.apply_body_inertia(spec, body, parameter)
        spec.body(body).iquat = [1, 0, 0, 0]

    return write


def free_parameters(spec: Any, model: Any, joints: list[str], rows: dict[str, Any]) -> Any:
    """Ten parameters per moving body and four per joint; initial values in proportion to the joint's torque."""
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
    spec = build_free((folder / "robot.urdf").read_text(encoding="utf-8"), joints)
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

    initial = free_parameters(spec, model, joints, rows)
    found = sysid.optimize(initial, residual, optimizer="mujoco", verbose=False, max_iters=FREE_ITERATIONS)[0]
    seconds = time.process_time() - start
    np.save(folder / "predicted.npy", predicted(found, *(job[f"held_out_{key}"] for key in "qva")))
    return {"seconds": seconds, "note": f"{found.size} free_parameters, {len(some)} rows"}


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    if not hasattr(sysid, "ParameterDict"):
        sys.exit("mujoco.sysid lacks its dependencies; run pip install 'mujoco[sysid]'")
    answer_each("mujoco", {"sysid": fit, "torque": predict}[sys.argv[1]])
