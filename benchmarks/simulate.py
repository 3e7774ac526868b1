"""Simulation speed in steps per second: `python -m benchmarks.simulate [--rounds 7] [--json FILE]`.

The seven joints of the Panda follow a motion under PD control with rigid-body feed-forward at 1 kHz. The baseline
("floor") is a bare loop around Pinocchio's forward dynamics with the same controller and no laws. MuJoCo's own step
with friction, damping and armature is called from Python for comparison. All run in turn in every round on one thread,
so that the load of the machine affects all alike; ratios are medians over the rounds.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from rich.console import Console
from rich.table import Table

from signid.effects import EFFECTS
from signid.model import Model, stated_inertials
from signid.robot import load_robot
from signid.simulation.plant import track
from signid.simulation.plant.control import Plan
from signid.simulation.plant.plant import Plant
from signid.types import Array, Law, Trajectory

from .plants.bodies import Body, bare as bare_urdf
from .summary import command_line, write_json

JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
CENTRE = (0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.0)  # centre of the motion [rad]
STEP, STEPS = 1e-3, 4000  # time step [s], steps per run
ARMATURE = 0.1  # kg.m2
LAWS = ("coulomb_friction", "viscous_friction", "torque_offset", "stribeck_friction", "load_friction")
COPIES = (16, 64, 256)
LIMIT = 5.0  # upper bound on time over the floor with armature and four more laws at every joint [1]
FLOOR, MUJOCO = "bare loop around pin.aba", "MuJoCo, friction + damping + armature"


def scene() -> tuple[Model, Plan, Array]:
    """The arm with rotors, the controller's plan and the times (N,) [s]."""
    robot = load_robot("panda", joints=JOINTS)
    armature = tuple(Law(EFFECTS["armature"], (j,), {"inertia": ARMATURE}) for j in range(len(JOINTS)))
    model = Model(robot, stated_inertials(robot), armature)
    t, w = np.arange(STEPS) * STEP, 2 * np.pi * np.linspace(0.3, 0.7, len(JOINTS))
    q, v, a = (np.sin, 1.0), (np.cos, w), (np.sin, -(w**2))
    waves = [0.5 * factor * wave(t[:, None] * w) for wave, factor in (q, v, a)]
    waves[0] = waves[0] + np.array(CENTRE)
    return model, track(model, Trajectory(robot.joints, t, *waves)).plan(t), t


def command(plan: Plan, k: int, q: Array, v: Array) -> Array:
    """Controller torque (n,) or (B, n) [N.m], computed at each step."""
    return plan.torque[k] + plan.stiffness * (plan.desired[k] - q) + plan.damping * (plan.speed[k] - v)


def bare(model: Model, plan: Plan) -> Callable[[], int]:
    """Return a function that runs the baseline and returns its number of steps."""
    inside = model.robot.model
    held = [inside.getJointId(name) for name in inside.names[1:] if name not in JOINTS]
    arm = pin.buildReducedModel(inside, held, pin.neutral(inside))
    arm.armature = np.full(len(JOINTS), ARMATURE)

    def run() -> int:
        data, q, v = arm.createData(), plan.desired[0].copy(), plan.speed[0].copy()
        for k in range(STEPS):
            v = v + STEP * pin.aba(arm, data, q, v, command(plan, k, q, v))
            q = q + STEP * v
        return STEPS

    return run


def signid_plant(model: Model, plan: Plan, laws: int, copies: int, integrator: str) -> Callable[[], int]:
    """Return a function that runs signid's plant with the first `laws` of LAWS at every joint, in parallel copies."""
    law = [Law(EFFECTS[name], (j,), EFFECTS[name].example) for name in LAWS[:laws] for j in range(len(JOINTS))]
    whole = Model(model.robot, model.inertials, (*model.laws, *law))
    plant = Plant(whole, STEP, copies, integrator)
    shift = np.linspace(0, 0.5, copies)[:, None]  # distinct positions of the copies [rad]
    steps = STEPS // (1 if copies == 1 else 8) // (4 if integrator == "rk4" else 1)

    def run() -> int:
        plant.start(plan.desired[0] + shift, np.tile(plan.speed[0], (copies, 1)))
        for k in range(steps):
            plant.advance(k * STEP, command(plan, k, plant.q - shift, plant.v))
        return steps * copies

    return run


def mujoco_step(model: Model, plan: Plan) -> Callable[[], int]:
    """Return a function that runs MuJoCo with its built-in friction, damping and armature."""
    arm = mujoco.MjModel.from_xml_string(bare_urdf(Body(model.robot.document, JOINTS)))
    arm.opt.timestep, arm.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    arm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    arm.dof_armature[:], arm.dof_damping[:], arm.dof_frictionloss[:] = ARMATURE, 2.0, 3.0

    def run() -> int:
        data = mujoco.MjData(arm)
        data.qpos[:], data.qvel[:] = plan.desired[0], plan.speed[0]
        for k in range(STEPS):
            data.qfrc_applied[:] = command(plan, k, data.qpos, data.qvel)
            mujoco.mj_step(arm, data)
        return STEPS

    return run


def contestants() -> dict[str, Callable[[], int]]:
    """All timed functions by name, the baseline first."""
    model, plan, _ = scene()
    make = partial(signid_plant, model, plan)
    found = {
        FLOOR: bare(model, plan),
        MUJOCO: mujoco_step(model, plan),
        "signid, armature": make(0, 1, "semi-implicit"),
    }
    for k in range(1, len(LAWS) + 1):
        found[f"  + {LAWS[k - 1]}"] = make(k, 1, "semi-implicit")
    found["signid, all of these, rk4"] = make(len(LAWS), 1, "rk4")
    found |= {f"signid, armature + four laws, {b} copies": make(4, b, "semi-implicit") for b in COPIES}
    return found


def measure(rounds: int) -> dict[str, dict[str, float]]:
    """Steps per second (best) and time per step over the floor's (median), by name."""
    runs = contestants()
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.perf_counter()
            steps = run()
            times[name].append((time.perf_counter() - start) / steps)
    floor = np.array(times[FLOOR])
    return {
        name: {"steps_per_second": float(1 / min(t)), "times_the_floor": float(np.median(np.array(t) / floor))}
        for name, t in times.items()
    }


def main() -> None:
    """Print the table; exit with 1 when armature and four more laws exceed the limit."""
    parser = command_line("simulate", __doc__)
    parser.add_argument("--rounds", type=int, default=7)
    chosen = parser.parse_args()
    found = measure(chosen.rounds)
    table = Table("", "steps/s", "times the floor", "times real time")
    for name, row in found.items():
        speed = row["steps_per_second"]
        table.add_row(name, f"{speed:,.0f}", f"{row['times_the_floor']:.2f}", f"{speed * STEP:,.0f}")
    Console(width=100).print(table)
    ratio = found[f"  + {LAWS[3]}"]["times_the_floor"]
    Console(width=100).print(f"armature and four more laws: {ratio:.1f} times the floor (at most {LIMIT:g})")
    about: dict[str, Any] = {"python": platform.python_version(), "pinocchio": pin.__version__}
    write_json(chosen.json, {**about, "mujoco": mujoco.__version__, "rows": found})
    raise SystemExit(ratio > LIMIT)


if __name__ == "__main__":
    main()
