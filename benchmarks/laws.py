"""Comparison of each law with independent simulators: `python -m benchmarks.laws [--plant bullet] [--json FILE]`.

The 3r arm moves in MuJoCo (or Bullet) with one planted law, implemented independently in the plant. From its exact
positions at 4 kHz, the recorded torque minus rigid bodies and rotors is compared with the torque of signid's law, both
through the same 15 Hz low-pass. `slope` is the size in the plant over the planted size; `left` is the rms residual over
the rms of the law. Laws that jump at zero velocity are compared without rows within 0.1 s of a joint velocity (or a sum
of two) below 0.05 rad/s, because joints stick there.
The plant's link_inertia keeps the inertia about the centre of mass; signid's law keeps that about the joint.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.ndimage import maximum_filter1d

from signid.effects import EFFECTS
from signid.effects.base import Effect
from signid.effects.law import law_torque
from signid.effects.naming import law_at
from signid.model import Model, stated_inertials
from signid.regression.bandwidth import lowpass, smooth
from signid.regression.motion import Motion
from signid.robot import load_robot
from signid.types import Array, Law, Robot

from .plants.bodies import Body, Drives
from .plants.control import Track, draw_motion
from .plants.faults import Fault
from .summary import command_line, write_json

SECONDS, RATE, CUTOFF = 20.0, 4000.0, 15.0  # duration [s], rate [Hz], low-pass [Hz]
SLOW, AWAY = 0.05, 0.1  # excluded near reversals: velocities below [rad/s], within [s]
CENTRE = (0.0, 0.3, 0.5)  # rad
ROTORS, RUBBING = (0.12, 0.10, 0.03), 3.0  # rotor inertia [kg.m2]; Coulomb friction for laws that modulate it [N.m]
ON_FRICTION = ("position_friction", "friction_drift")
OTHER = {
    "torque_saturation": {"limit": 4.0},
    "joint_elasticity": {"stiffness": 1500.0},
    "joint_coupling": {"inertia": 0.02},
}
JUMPING = ("joint_coupling",)  # discontinuous in the sum of two velocities
SLOPE, LEFT = 0.02, 0.05  # tolerances: |slope - 1|, residual over law [1]
LOOSE = {"backlash": (0.05, 0.25), "time_delay": (0.02, 0.1), "torque_lag": (0.02, 0.1), "base_tilt": (0.03, 0.05)}


class Row(NamedTuple):
    """Comparison of one law with the plant."""

    effect: str
    joint: str | None
    slope: float
    left: float

    @property
    def right(self) -> bool:
        """Whether slope and residual are within the tolerances."""
        slope, left = LOOSE.get(self.effect, (SLOPE, LEFT))
        return abs(self.slope - 1) <= slope and self.left <= left


def planted(effect: Effect, robot: Robot) -> Fault:
    """The law at the arm's second joint with example values."""
    joint = {"robot": None, "any": None, "tip": robot.joints[-1]}.get(effect.scope, robot.joints[1])
    values: dict[str, float | str] = {**effect.example, **OTHER.get(effect.name, {})}
    if effect.scope == "pair":
        values["partner"] = robot.joints[2]
    return Fault(effect.name, joint, values)


def compare(name: str, effect: Effect) -> Row:
    """Simulate the law in a plant and compare the recorded torque with signid's law."""
    robot = load_robot("3r")
    fault = planted(effect, robot)
    rubbing = RUBBING if effect.name in ON_FRICTION else 0.0
    drives = Drives(ROTORS, (0.0,) * 3, (0.0, rubbing, 0.0), (0.0,) * 3)
    plant = importlib.import_module(f".plants.{name}", __package__)
    track = plant.simulate(Body(robot.document, robot.joints), drives, draw_motion(CENTRE, 1), SECONDS, RATE, [fault])
    law = law_at(effect, robot, fault.joint, fault.parameters)
    known = [Law(EFFECTS["armature"], (j,), {"inertia": x}) for j, x in enumerate(ROTORS)]
    known += [Law(EFFECTS["coulomb_friction"], (1,), {"level": rubbing})] if rubbing else []
    motion = _motion(Model(robot, stated_inertials(robot), tuple(known)), track)
    recorded = motion.recorded if motion.recorded is not None else motion.load
    extra = recorded - sum((_full(other, motion) for other in known), motion.load)
    taps = lowpass(RATE, CUTOFF)
    seen, predicted = smooth(extra, taps), smooth(_full(law, motion), taps)
    if effect.name in JUMPING or "sign(" in effect.equation:
        near = _near(motion)[len(taps) // 2 : len(motion) - len(taps) // 2]
        seen, predicted = np.where(near, 0.0, seen), np.where(near, 0.0, predicted)
    size = float(np.sum(predicted**2))
    return Row(
        effect.name,
        fault.joint,
        float(np.sum(seen * predicted)) / size,
        float(np.sum((seen - predicted) ** 2) / size) ** 0.5,
    )


def _motion(known: Model, track: Track) -> Motion:
    """Motion from exact positions by central differences."""
    step, inner = 1 / RATE, slice(1, -1)
    q = track.q
    v, a = (q[2:] - q[:-2]) / (2 * step), (q[2:] - 2 * q[1:-1] + q[:-2]) / step**2
    bare = Motion(known.robot, track.t[inner], q[inner], v, a)
    return Motion(known.robot, bare.t, bare.q, v, a, recorded=track.tau[inner], predicted=known.inverse(bare))


def _full(law: Law, motion: Motion) -> Array:
    rows, torque = law_torque(law, motion)
    out = np.zeros_like(motion.q)
    out[:, list(rows)] = torque
    return out


def _near(motion: Motion) -> np.ndarray:
    """Mask (N, n) of rows within AWAY [s] of a joint velocity, or a sum of two, below SLOW."""
    v = motion.v
    slow = np.abs(v) < SLOW
    for j, k in combinations(range(v.shape[1]), 2):
        slow[:, [j, k]] |= (np.abs(v[:, j] + v[:, k]) < SLOW)[:, None]
    return np.asarray(maximum_filter1d(slow, 2 * int(AWAY * RATE) + 1, axis=0))


def compare_all(name: str, only: list[str]) -> Iterator[Row]:
    """Yield a row for each law that the plant supports."""
    for effect in EFFECTS:
        if effect.name == "gravity":  # a vector in the place of another one: it has no slope at zero
            continue
        if only and effect.name not in only or name == "pybullet_" and effect.name in ("joint_elasticity", "backlash"):
            continue
        yield compare(name, effect)


def main() -> None:
    """Print the table; exit with 1 when a law differs from the plant."""
    parser = command_line("laws", __doc__)
    parser.add_argument("--plant", choices=("mujoco", "bullet"), default="mujoco")
    parser.add_argument("--only", nargs="*", default=[], metavar="EFFECT")
    chosen = parser.parse_args()
    table, rows = Table("law", "at", "slope", "left", ""), []
    for row in compare_all({"mujoco": "mujoco_", "bullet": "pybullet_"}[chosen.plant], chosen.only):
        rows.append(row)
        table.add_row(
            row.effect, row.joint or "all", f"{row.slope:.4f}", f"{row.left:.2%}", "" if row.right else "differs"
        )
    Console(width=100).print(table)
    write_json(chosen.json, [row._asdict() for row in rows])
    raise SystemExit(not all(row.right for row in rows))


if __name__ == "__main__":
    main()
