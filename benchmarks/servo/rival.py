"""CMA-ES on the same simulator, windows and numbers as the identification (needs the package `cma`)."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from signid.model import load_model, with_servos
from signid.recording import read_recording
from signid.servo.diagnose.closed_loop import ClosedLoop
from signid.servo.fit import fit_servos, start_servos
from signid.servo.fit.coordinates import Coordinates
from signid.servo.identify import identify_servos
from signid.servo.search.data import servo_data
from signid.servos import Servo

from .drive import Array

NUMBERS = ("kp", "kd", "coulomb_friction", "armature", "delay", "effort_limit", "load_friction")
TYPICAL = {"kp": 5.0, "kd": 0.2, "coulomb_friction": 0.05, "armature": 0.005, "delay": 0.01, "effort_limit": 2.0}
TRIALS, WINDOW = 3000, 0.8


@dataclass(frozen=True)
class Race:
    """Held-out errors [rad] over windows, and processor times [s], until CMA-ES is as good on the training windows."""

    ours: float
    ours_seconds: float  # everything: choice of law and numbers, intervals, roll-outs
    fit: float
    fit_seconds: float  # start and fit of the same numbers as CMA-ES
    cma: float
    cma_seconds: float
    cma_trials: int


def race(urdf: Path, recording: Path) -> Race:
    """Identify a single joint, then let CMA-ES search until it reaches the same cost or the trials end."""
    import cma

    model = load_model(urdf)
    read = read_recording(str(recording), model.robot)
    start = time.process_time()
    found = identify_servos(model, read)
    ours_seconds = time.process_time() - start
    data = servo_data(model.robot, [read], [])
    best = found.servos[data.joints[0]]
    train, unseen = (ClosedLoop(model, grids, [0], (best,), WINDOW) for grids in (data.train, data.held_out))
    start = time.process_time()
    first = start_servos(with_servos(model, found.servos), data.train, best.law)
    fit = fit_servos(
        model, data.train, first, [(data.joints[0], name) for name in NUMBERS], window=WINDOW, scales=False
    )
    fit_seconds = time.process_time() - start
    alone = fit.servos[data.joints[0]]
    goal = 1.01 * _rms(train, [alone])[0]
    search = cma.CMAEvolutionStrategy(np.zeros(len(NUMBERS)), 0.7, {"seed": 1, "verbose": -9, "maxfevals": TRIALS})
    start = time.process_time()
    while not search.stop():
        asked = search.ask()
        costs = _rms(train, [_servo(x, best.law) for x in asked])
        search.tell(asked, costs)
        if min(costs) <= goal:
            break
    seconds = time.process_time() - start
    theirs = _servo(search.result.xbest, best.law)
    ours, ours_fit, other = (_rms(unseen, [servo])[0] for servo in (best, alone, theirs))
    return Race(ours, ours_seconds, ours_fit, fit_seconds, other, seconds, int(search.result.evaluations))


def _servo(x: Array, law: str) -> Servo:
    numbers = {name: TYPICAL.get(name, 0.1) * float(np.exp(at)) for name, at in zip(NUMBERS, x, strict=True)}
    return Servo(law=law, **numbers)  # type: ignore[arg-type]


def _rms(loop: ClosedLoop, servos: list[Servo]) -> list[float]:
    residual = loop.residuals([Coordinates((servo,)) for servo in servos])
    return [float(x) for x in np.sqrt(np.mean(np.nan_to_num(residual, nan=1e3) ** 2, axis=(1, 2, 3)))]
