"""Changes of a log that must not matter: clocks, losses, rates, units, columns, files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from ..plants.control import Array

Columns = Mapping[str, Array]
Generator = np.random.Generator


@dataclass(frozen=True)
class Changed:
    """Replacement of the original log: one log or several, a column map, a rotation of the base."""

    logs: tuple[dict[str, Array], ...]
    map: str = ""  # TOML of a column map
    turned: tuple[float, float, float] | None = None  # roll, pitch, yaw of the base [rad]
    file: str = "csv"  # or "parquet"


@dataclass(frozen=True)
class Change:
    """A change with its name."""

    name: str
    make: Callable[[Columns, Generator], Changed]
    drives: bool = True  # whether it applies to commands and positions


def _one(make: Callable[[Columns, Generator], Mapping[str, Array]]) -> Callable[[Columns, Generator], Changed]:
    return lambda columns, rng: Changed((dict(make(columns, rng)),))


def _stamps(make: Callable[[Array, Generator], Array]) -> Callable[[Columns, Generator], Changed]:
    return _one(lambda columns, rng: {**columns, "t": make(columns["t"], rng)})


def _rows(keep: Callable[[int, Generator], NDArray[Any]]) -> Callable[[Columns, Generator], Changed]:
    def make(columns: Columns, rng: Generator) -> dict[str, Array]:
        rows = keep(len(columns["t"]), rng)
        return {name: x[rows] for name, x in columns.items()}

    return _one(make)


def milliseconds(t: Array, rng: Generator) -> Array:
    """Whole milliseconds, 1 early, right, or 1 late."""
    return np.asarray(np.round(t, 3) + 1e-3 * rng.integers(-1, 2, len(t)))


def _gaussian(t: Array, rng: Generator) -> Array:
    return np.asarray(t + np.clip(0.1 * rng.standard_normal(len(t)), -0.4, 0.4) * np.median(np.diff(t)))


def _resampled(factor: float, kind: str) -> Callable[[Columns, Generator], Changed]:
    """Another rate by interpolation of every column, or held."""

    def make(columns: Columns, _: Generator) -> dict[str, Array]:
        t = columns["t"]
        count = int((len(t) - 1) * factor + 1e-9) + 1
        new = t[0] + np.arange(count) * (t[-1] - t[0]) / (len(t) - 1) / factor
        new = np.minimum(new, t[-1])
        return {name: new if name == "t" else _at(t, x, new, kind) for name, x in columns.items()}

    return _one(make)


def _at(t: Array, x: Array, new: Array, kind: str) -> Array:
    if kind == "linear":
        return np.interp(new, t, x)
    if kind == "held":
        return x[np.searchsorted(t, new + 1e-9, side="right") - 1]
    return np.asarray((CubicSpline if kind == "cubic" else PchipInterpolator)(t, x)(new))


def _lost(share: float) -> Callable[[int, Generator], NDArray[Any]]:
    def keep(rows: int, rng: Generator) -> NDArray[Any]:
        kept = rng.random(rows) >= share
        kept[[0, -1]] = True
        return np.flatnonzero(kept)

    return keep


def _gap(rows: int, rng: Generator) -> NDArray[Any]:
    first = int(rows * 0.4)
    return np.r_[np.arange(first), np.arange(first + rows // 40, rows)]


def _degrees(columns: Columns, _: Generator) -> Changed:
    log = {name: np.degrees(x) if name.startswith("q_") else x for name, x in columns.items()}
    return Changed((log,), '[units]\nq = "deg"\nq_des = "deg"\n')


def _renamed(columns: Columns, _: Generator) -> Changed:
    log = {f"log/{name}" if name != "t" else "stamp": x for name, x in columns.items()}
    return Changed((log,), "".join(f'{name} = "{new}"\n' for name, new in zip(columns, log, strict=True)))


def _in_milliseconds(columns: Columns, _: Generator) -> Changed:
    return Changed(({**columns, "t": 1e3 * columns["t"]},), '[units]\nt = "ms"\n')


def _resting(before: float, after: float) -> Callable[[Columns, Generator], Changed]:
    """Rest before and after the motion, with the noise of the last digits of torque."""

    def make(columns: Columns, rng: Generator) -> dict[str, Array]:
        t = columns["t"]
        step = float(np.median(np.diff(t)))
        first, last = round(before / step), round(after / step)
        out = {"t": np.r_[t[0] - step * np.arange(first, 0, -1), t, t[-1] + step * np.arange(1, last + 1)]}
        for name, x in columns.items():
            if name != "t":
                out[name] = np.r_[np.full(first, x[0]), x, np.full(last, x[-1])]
        return out

    return _one(make)


def _missing(share: float, kind: str) -> Callable[[Columns, Generator], Changed]:
    def make(columns: Columns, rng: Generator) -> dict[str, Array]:
        out = {name: x.copy() for name, x in columns.items()}
        rows = rng.choice(len(out["t"]), max(1, round(share * len(out["t"]))), replace=False)
        for name in out:
            if name.startswith(kind):
                out[name][rows] = np.nan
        return out

    return _one(make)


def _pieces(columns: Columns, _: Generator) -> Changed:
    edges = np.linspace(0, len(columns["t"]), 4).astype(int)
    pairs = zip(edges[:-1], edges[1:], strict=True)
    return Changed(tuple({name: x[a:b] for name, x in columns.items()} for a, b in pairs))


def _repeated(rows: int, rng: Generator) -> NDArray[Any]:
    return np.sort(np.r_[np.arange(rows), rng.choice(rows, max(1, rows // 200), replace=False)])


def _wrapped(span: float) -> Callable[[Columns, Generator], Changed]:
    """Positions of the first joint in a register that begins again between its first and its largest position."""

    def make(columns: Columns, _: Generator) -> dict[str, Array]:
        first = next(name for name in columns if name.startswith("q_") and not name.startswith("q_des"))
        x = columns[first]
        end = float(x[0] + x.max()) / 2
        return {**columns, first: end - span + (x - end) % span}

    return _one(make)


def _precise(columns: Columns, _: Generator) -> dict[str, Array]:
    return {name: x.astype(np.float32).astype(np.float64) for name, x in columns.items()}


CHANGES = (
    Change("whole ms, -1 to 1 ms off", _stamps(milliseconds)),
    Change("stamps 10 % of a row off", _stamps(_gaussian)),
    Change("2 % of rows lost", _rows(_lost(0.02))),
    Change("rows lost, stamps off", lambda c, g: Changed(tuple(
        {**log, "t": _gaussian(log["t"], g)} for log in _rows(_lost(0.02))(c, g).logs
    ))),
    Change("a gap", _rows(_gap)),
    Change("linear, 2 times the rate", _resampled(2, "linear")),
    Change("linear, 5 times", _resampled(5, "linear")),
    Change("linear, 1.6 times", _resampled(1.6, "linear")),
    Change("cubic, 2 times", _resampled(2, "cubic")),
    Change("cubic, 5 times", _resampled(5, "cubic")),
    Change("cubic, 1.6 times", _resampled(1.6, "cubic")),
    Change("pchip, 4 times", _resampled(4, "pchip")),
    Change("held, 2 times", _resampled(2, "held")),
    Change("held, 4 times", _resampled(4, "held")),
    Change("every other row", _rows(lambda rows, _: np.arange(0, rows, 2))),
    Change("cubic, .8 times", _resampled(0.8, "cubic")),
    Change("degrees, map", _degrees),
    Change("milliseconds, map", _in_milliseconds),
    Change("other names, map", _renamed),
    Change("columns backwards", _one(lambda columns, _: dict(reversed(columns.items())))),
    Change("4 s of rest before", _resting(4.0, 0.0)),
    Change("4 s of rest after an abrupt stop", _resting(0.0, 4.0)),
    Change("one row without values", _missing(0.0, "tau_"), drives=False),
    *(Change(f"{k} % of torques missing", _missing(k / 100, "tau_"), drives=False) for k in (1, 5)),
    Change("one position missing", _missing(0.0, "q_")),
    *(Change(f"{k} % of positions missing", _missing(k / 100, "q_")) for k in (2, 5)),
    Change("three pieces", _pieces),
    Change("rows repeated", _rows(_repeated)),
    Change("float32", _one(_precise)),
    Change("stamps since 1970", _stamps(lambda t, _: t + 1.7e9)),
    Change("stamps from 1000 s", _stamps(lambda t, _: t + 1e3)),
    Change("register of 2 pi", _wrapped(2 * np.pi)),
    Change("register of 25 rad", _wrapped(25.0)),
    Change("base on a wall, --gravity", lambda c, _: Changed((dict(c),), turned=(np.pi / 2, 0.0, 0.0)), drives=False),
    Change("base tilted, --gravity", lambda c, _: Changed((dict(c),), turned=(0.4, -0.3, 1.0)), drives=False),
    Change("Parquet", lambda c, _: Changed((dict(c),), file="parquet")),
)  # fmt: skip
