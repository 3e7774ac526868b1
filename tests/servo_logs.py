"""Logs of simulated servos, and faults to put into logs."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from signid.faults import JointAudit
from signid.faults.commands import audit_servos
from signid.recording import read_bare
from signid.types import Array, Recording

DATA = Path(os.environ.get("SIGNID_DATA", "nowhere"))
PUBLIC = pytest.mark.skipif(not DATA.is_dir(), reason="public recordings are not here (SIGNID_DATA)")
Columns = dict[str, Array]


def drive(
    rate: float = 100.0, seconds: float = 30.0, speed: float = 25.0, damping: float = 0.9, delay: float = 0.03,
    friction: float = 0.0, droop: float = 0.0, seed: int = 1,
) -> Columns:  # fmt: skip
    """A joint of second order with a delay, whose command is smooth and stays still now and then; 12 bit encoder."""
    fine, rng = 10, np.random.default_rng(seed)
    n, h = int(seconds * rate), 1 / rate / fine
    t = np.arange(n) / rate
    phases = rng.uniform(0, 2 * np.pi, 5)
    c = sum(0.5 / (k + 1) * np.sin(2 * np.pi * 0.37 * (k + 1) * t + phase) for k, phase in enumerate(phases))
    still = (t % 6) > 4.5
    c = np.where(still, c[np.searchsorted(t, np.floor(t / 6) * 6 + 4.5).clip(0, n - 1)], c)
    held = np.repeat(c, fine)
    late = round(delay / h)
    held = np.concatenate([np.full(late, held[0]), held])[: len(held)]
    q, v, out = held[0], 0.0, np.empty(len(held))
    for k, goal in enumerate(held):
        free = v + h * (speed**2 * (goal - droop - q) - 2 * damping * speed * v)
        most = h * speed**2 * friction
        v = np.sign(free) * max(0.0, abs(free) - most)
        q += h * v
        out[k] = q
    step = 2 * np.pi / 4096
    return {"t": t, "q_a": np.round(out[::fine] / step) * step, "q_des_a": c}


def recording(columns: Columns) -> Recording:
    found, _ = read_bare(columns)
    return found


def audit(columns: Columns) -> JointAudit:
    [one] = audit_servos(recording(columns)).joints
    return one


def negated(x: Columns, joint: str) -> Columns:
    return {**x, f"q_{joint}": -x[f"q_{joint}"]}


def leading(x: Columns, joint: str) -> Columns:
    rows = int(0.3 / np.median(np.diff(x["t"])))
    c = x[f"q_des_{joint}"]
    return {**x, f"q_des_{joint}": np.concatenate([np.full(rows, c[0]), c[:-rows]])}


def late(x: Columns, joint: str) -> Columns:
    rows = int(0.3 / np.median(np.diff(x["t"])))
    q = x[f"q_{joint}"]
    return {**x, f"q_{joint}": np.concatenate([np.full(rows, q[0]), q[:-rows]])}


def held(x: Columns, joint: str) -> Columns:
    q = x[f"q_{joint}"]
    return {**x, f"q_{joint}": q[np.arange(len(q)) // 3 * 3]}


def degrees(x: Columns, joint: str) -> Columns:
    return {**x, f"q_{joint}": np.degrees(x[f"q_{joint}"])}


def turned(x: Columns, joint: str) -> Columns:
    q = x[f"q_{joint}"]
    return {**x, f"q_{joint}": np.where(q > np.quantile(q, 0.6), q - 2 * np.pi, q)}


def copied(x: Columns, joint: str) -> Columns:
    return {**x, f"q_des_{joint}": x[f"q_{joint}"]}


def following(x: Columns, joint: str) -> Columns:
    return {**x, f"q_des_{joint}": np.roll(x[f"q_{joint}"], -1)}


def limp(x: Columns, joint: str) -> Columns:
    return {**x, f"q_{joint}": np.full(len(x["t"]), x[f"q_{joint}"][0])}


def noisy(x: Columns, joint: str) -> Columns:
    c = x[f"q_des_{joint}"]
    return {**x, f"q_des_{joint}": c + 0.05 * np.ptp(c) * np.random.default_rng(1).standard_normal(len(c))}


def zeroed(x: Columns, joint: str) -> Columns:
    return {**x, f"q_{joint}": x[f"q_{joint}"] + np.ptp(x[f"q_{joint}"])}


FAULTS: dict[Callable[[Columns, str], Columns], str] = {
    negated: "moves against its command",
    leading: "q leads q_des",
    late: "begins to answer",
    held: "repeat the position before",
    degrees: "in degrees",
    turned: "the encoder wraps around",
    copied: "q_des equals q",
    following: "q_des equals q, 1 row later",
    limp: "does not follow",
    noisy: "noise",
    zeroed: "zeros of q and q_des differ",
}


def read_public(name: str) -> tuple[tuple[str, ...], Columns]:
    frame = pl.read_csv(DATA / name, infer_schema_length=None)
    columns = {
        each: frame[each].cast(pl.Float64).to_numpy() for each in frame.columns if frame[each].dtype.is_numeric()
    }
    return tuple(each.removeprefix("q_des_") for each in frame.columns if each.startswith("q_des_")), columns
