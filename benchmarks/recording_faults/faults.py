"""Faults planted in the columns of recordings: signs, orders, units, lags, gains, clipping, stuck or short logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..plants.control import Array

Columns = dict[str, Array]
Spoil = Callable[[list[Columns], tuple[int, ...], np.random.Generator], list[Columns]]

STRONG = 0.1  # least torque deviation of a faulty joint over the largest one [1]


def each(change: Callable[[Columns], Columns]) -> Callable[[list[Columns]], list[Columns]]:
    """Apply a change of columns to every recording."""
    return lambda recordings: [{**columns, **change(columns)} for columns in recordings]


def scaled(key: str, factor: float) -> Spoil:
    """Scale the columns of the joints."""
    return lambda logs, js, rng: each(lambda c: {f"{k}_{j}": factor * c[f"{k}_{j}"] for k in key.split() for j in js})(
        logs
    )


def exchanged(key: str) -> Spoil:
    """Exchange the columns of two joints."""
    return lambda logs, js, rng: each(
        lambda c: {f"{k}_{a}": c[f"{k}_{b}"] for k in key.split() for a, b in zip(js, js[::-1], strict=True)}
    )(logs)


def late(logs: list[Columns], js: tuple[int, ...], rng: np.random.Generator) -> list[Columns]:
    """Delay torques by 90 to 150 ms."""
    lag = rng.uniform(0.09, 0.15)
    return each(lambda c: {f"tau_{j}": np.interp(c["t"] - lag, c["t"], c[f"tau_{j}"]) for j in js})(logs)


def currents(logs: list[Columns], js: tuple[int, ...], rng: np.random.Generator) -> list[Columns]:
    """Divide torques by constants of 7 to 12 N.m/A."""
    constant = dict(zip(js, rng.uniform(7, 12, len(js)), strict=True))
    return each(lambda c: {f"tau_{j}": c[f"tau_{j}"] / constant[j] for j in js})(logs)


def clipped(logs: list[Columns], js: tuple[int, ...], rng: np.random.Generator) -> list[Columns]:
    """Clip torque at 70 % of its largest value."""
    most = {j: 0.7 * max(np.abs(c[f"tau_{j}"]).max() for c in logs) for j in js}
    return each(lambda c: {f"tau_{j}": np.clip(c[f"tau_{j}"], -most[j], most[j]) for j in js})(logs)


def stuck(logs: list[Columns], js: tuple[int, ...], rng: np.random.Generator) -> list[Columns]:
    """Hold the torque for one second in the first recording."""
    at = int(rng.integers(200, len(logs[0]["t"]) - 400))

    def hold(x: Array) -> Array:
        return np.where((np.arange(len(x)) >= at) & (np.arange(len(x)) < at + 125), x[at], x)

    return each(lambda c: {f"tau_{j}": hold(c[f"tau_{j}"]) for j in js})(logs[:1]) + logs[1:]


def short(logs: list[Columns], js: tuple[int, ...], rng: np.random.Generator) -> list[Columns]:
    """Keep four seconds of one recording, or eight for seven joints."""
    rows = 1000 if len(logs[0]) > 14 else 500
    return [{key: x[:rows] for key, x in logs[0].items()}]


FAULTS: Mapping[str, tuple[str, int, Spoil]] = {  # expected finding, number of joints (0: all), change
    "torque sign": ("torque sign", 1, scaled("tau", -1.0)),
    "position sign": ("position sign", 1, scaled("q", -1.0)),
    "axis": ("axis", 1, scaled("q tau", -1.0)),
    "torque order": ("torque order", 2, exchanged("tau")),
    "position order": ("position order", 2, exchanged("q")),
    "joint order": ("joint order", 2, exchanged("q tau")),
    "degrees": ("degrees", 0, scaled("q", 180 / np.pi)),
    "late": ("lag", 0, late),
    "one late": ("lag", 1, late),
    "mN.m": ("units", 0, scaled("tau", 1000.0)),
    "currents": ("units", 0, currents),
    "gain 2.5": ("gain", 1, scaled("tau", 2.5)),
    "gain 0.4": ("gain", 1, scaled("tau", 0.4)),
    "clipped": ("clipping", 1, clipped),
    "stuck": ("stuck torque", 1, stuck),
    "4 or 8 s": ("too little data", 0, short),
}
ALONE = (  # not planted in robots with a single joint
    *("torque order", "position order", "joint order"),
    *("gain 2.5", "gain 0.4", "4 or 8 s", "axis"),
)


def spoiled(
    fault: str, logs: list[Columns], joints: Sequence[str], rng: np.random.Generator
) -> tuple[list[Columns], tuple[str, ...]] | None:
    """Recordings with a planted fault and the names of its joints; None without enough strong joints."""
    _, count, spoil = FAULTS[fault]
    n = len(joints)
    size = np.array([np.std(np.concatenate([c[f"tau_{j + 1}"] for c in logs])) for j in range(n)])
    strong = np.flatnonzero(size >= STRONG * size.max())
    if count > len(strong):
        return None
    chosen = sorted((rng.choice(strong, count, replace=False) if count else np.arange(n)).tolist())
    return spoil(logs, tuple(j + 1 for j in chosen), rng), tuple(joints[j] for j in chosen) if count else ()
