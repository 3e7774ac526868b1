"""Senseless recordings of position drives, made from healthy ones; positions and commands only."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from servo_loops import driven, motion

from signid.servo.plant import roll_out
from signid.servos import Servo
from signid.types import Array

Columns = Mapping[str, Array]
SWING = Servo(kp=300.0, kd=15.0, delay=0.02, viscous_friction=0.1, coulomb_friction=0.2)


def healthy(seed: int = 1, seconds: float = 20.0) -> dict[str, Array]:
    """A simulated `1r` whose drive follows smooth commands, 100 rows a second; keys t, q_1, q_des_1."""
    model = driven("1r", {"joint_1": SWING})
    grid = motion(model, seed, seconds=seconds, repeats=1)
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(grid))
    return {
        "t": np.arange(len(grid)) * grid.step,
        "q_1": roll_out(model, model.servos, grid)[:, 0] + noise,
        "q_des_1": grid.command[:, 0].copy(),
    }


def senseless(good: Columns, other: Columns, seed: int = 0) -> dict[str, dict[str, Array]]:
    """Senseless recordings by name; good and other: healthy ones of two motions with equally many rows."""
    t, q, c = good["t"], good["q_1"], good["q_des_1"]
    rng, n, span = np.random.default_rng(seed), len(t), float(np.ptp(c))
    second = round(1 / float(np.median(np.diff(t))))
    hit = rng.random(n) < 0.05
    rows = np.arange(n)
    stuck = np.where(rows > n // 2, q[n // 2], q)
    changed: dict[str, dict[str, Array]] = {
        "noise": {"q_1": 0.3 * span * rng.standard_normal(n)},
        "random walk": {"q_1": np.cumsum(0.02 * span * rng.standard_normal(n))},
        "constant command": {"q_des_1": np.full(n, c.mean())},
        "constant position": {"q_1": np.full(n, q[0])},
        "both constant": {"q_1": np.full(n, q[0]), "q_des_1": np.full(n, c[0])},
        "stuck": {"q_1": stuck},
        "stuck now and then": {"q_1": np.where(rows % 200 > 150, q[rows - np.maximum(rows % 200 - 150, 0)], q)},
        "halved": {"q_1": 0.5 * q},
        "off by 90 degrees": {"q_1": q + np.pi / 2},
        "early by 1 s": {"q_1": np.roll(q, -second)},
        "late by 1 s": {"q_1": np.roll(q, second)},
        "spikes": {"q_1": q + np.where(hit, span * rng.standard_normal(n), 0.0)},
        "spikes of the command": {"q_des_1": c + np.where(hit, span * rng.standard_normal(n), 0.0)},
        "drop-outs": {"q_1": np.where(hit, 0.0, q)},
        "drop-outs of the command": {"q_des_1": np.where(hit, 0.0, c)},
        "8 bits of a turn": {"q_1": np.round(q / (2 * np.pi) * 256) * 2 * np.pi / 256},
        "three levels": {"q_1": span * np.sign(np.round(2 * q / span))},
        "another motion": {"q_des_1": other["q_des_1"]},
        "commands in any order": {"q_des_1": rng.permutation(c)},
        "reversed in time": {"q_1": q[::-1].copy(), "q_des_1": c[::-1].copy()},
        "position reversed": {"q_1": q[::-1].copy()},
        "exchanged": {"q_1": c, "q_des_1": q},
        "position twice as fast": {"q_1": np.interp(2 * t, t, q)},
        "position half as fast": {"q_1": np.interp(0.5 * t, t, q)},
        "negated position": {"q_1": -q},
        "signs at random": {"q_1": q * rng.choice([-1.0, 1.0], n)},
    }
    return {name: {"t": t, "q_1": q, "q_des_1": c, **change} for name, change in changed.items()}


Make = Callable[[], dict[str, Array]]
