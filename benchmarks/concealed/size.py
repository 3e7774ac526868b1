"""Faults of a given size: rms torque of the fault over that of the joint or of all joints."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..plants.faults import Fault
from ..plants.mujoco_ import simulate
from .extra import extra
from .motion import PERIOD
from .scene import Scene, rms
from .shapes import SPREAD, UNSIZED, draw, scaled

ATTEMPTS, TURNS, CLOSE, CLOSE_ENOUGH = 6, 8, 0.01, 0.15  # draws, scaling steps, tolerances of the size [1]
PUSH = 2.0  # torque of a contact while it lasts, over the size [1]
NOTHING, HALF = 1e-6, 0.5  # size treated as zero, smallest accepted share of the requested size [1]
TILT, LARGEST_OFFSET = 0.5, 0.3  # upper bounds on base tilt and encoder offset [rad]
LOG = 500.0  # rate of a trial simulation [Hz]
SMOOTH = 25  # half width of the torque average in a trial [rows]


def plant(effect: str, joint: str, size: float, scene: Scene, rng: np.random.Generator) -> tuple[Fault, float]:
    """Draw a fault of an effect and scale it to a size; return it with the size reached.

    Raises:
        ValueError: when no draw reaches the size.
    """
    for _ in range(ATTEMPTS):
        fault = draw(effect, scene, joint, rng)
        if effect in UNSIZED:
            return fault, float(measure(scene, fault))
        try:
            found = _sized(scene, fault, size * (PUSH if effect == "external_contact" else 1.0))
        except (ValueError, ArithmeticError):
            continue
        if found is not None:
            return found
    raise ValueError(f"no {effect} at {joint} reaches {size:.0%} of the torque")


def measure(scene: Scene, fault: Fault) -> float:
    """Rms torque of a fault over that of the joint or of all joints; for a contact, while it lasts."""
    torque, j = extra(scene, fault), 0 if fault.joint is None else scene.body.joints.index(fault.joint)
    if fault.effect == "external_contact":
        torque = torque[(scene.t >= fault.numbers["start"]) & (scene.t <= fault.numbers["end"])]
    if fault.effect in SPREAD:
        return float(np.sqrt(np.sum(rms(torque) ** 2) / np.sum(rms(scene.bodies) ** 2)))
    share = rms(torque) / scene.scale
    if fault.effect == "joint_coupling":
        return float(share.max())
    return float(share[j])


def _sized(scene: Scene, fault: Fault, size: float) -> tuple[Fault, float] | None:
    if fault.effect == "torque_saturation":
        return _clipped(scene, fault, size)
    size_of: Callable[[Scene, Fault], float] = _tried if fault.effect == "backlash" else measure
    if fault.effect == "backlash":
        fault = scaled(fault, size)
    turns, close = (3, CLOSE_ENOUGH) if fault.effect == "backlash" else (TURNS, CLOSE)
    found = size_of(scene, fault)
    for _ in range(turns):
        if found < NOTHING:
            return None
        if abs(found / size - 1) < close:
            break
        fault = scaled(fault, float(np.clip(size / max(found, 1e-12), 1e-4, 1e4)))
        found = size_of(scene, fault)
    if fault.effect == "encoder_offset" and abs(fault.numbers["offset"]) > LARGEST_OFFSET:
        fault = scaled(fault, LARGEST_OFFSET / abs(fault.numbers["offset"]))
        found = size_of(scene, fault)
    if fault.effect == "base_tilt" and np.hypot(fault.numbers["x"], fault.numbers["y"]) > TILT:
        return None
    return (fault, found) if found > HALF * size else None


def _clipped(scene: Scene, fault: Fault, size: float) -> tuple[Fault, float] | None:
    """Bisect the limit of a torque saturation."""
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        limit = middle * float(np.abs(scene.whole[:, scene.body.joints.index(str(fault.joint))]).max())
        trial = Fault(fault.effect, fault.joint, {"limit": limit})
        low, high = (low, middle) if (found := measure(scene, trial)) < size else (middle, high)
    return (trial, found) if found > (1 - CLOSE) * size else None


def _tried(scene: Scene, fault: Fault) -> float:
    """Size of a fault by simulation: simulated torque minus inverse dynamics of the simulated motion."""
    j = scene.body.joints.index(str(fault.joint))
    drives, motion = scene.rotors, scene.motions[0]
    track = simulate(scene.body, drives, motion, PERIOD, LOG, [fault])
    v = np.gradient(track.q, track.t, axis=0)
    a = np.gradient(v, track.t, axis=0)
    rest = (track.tau - scene.inverse(track.q, v, a))[:, j]
    window = np.hanning(2 * SMOOTH + 1)
    rest = np.convolve(rest, window / window.sum(), "valid")
    return float(rms(rest) / scene.scale[j])
