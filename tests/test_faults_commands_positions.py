"""Logs of commands whose positions are halved, levelled, drifting or frozen are named, and healthy ones are silent."""

from __future__ import annotations

import numpy as np
import pytest
from servo_logs import PUBLIC, read_public, recording

from signid.faults.commands import audit_servos
from signid.types import Array

LOGS = ["go2_dls/held_base_first.csv.gz", "bam_sts3250/kp32_sin_time_square.csv.gz"]


def spoilt(kind: str, t: Array, q: Array, command: Array) -> tuple[Array, Array]:
    """Position and command with a fault."""
    span, k = float(np.ptp(command)), int(0.6 * len(t))
    if kind == "drift":
        return q + 0.25 * span * (t - t[0]) / np.ptp(t), command
    if kind == "rounded":
        return q, np.round(command / (span / 7)) * span / 7
    if kind == "levels":
        return np.round(q / (span / 6)) * span / 6, command
    if kind == "frozen":
        return np.where(np.arange(len(t)) < k, q, q[k]), np.where(np.arange(len(t)) < k, command, command[k])
    return q, command


@PUBLIC
@pytest.mark.parametrize("name", LOGS)
@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("", ""),
        ("drift", "the zero of q drifts"),
        ("rounded", "q_des is rounded"),
        ("levels", "different values"),
        ("frozen", "stops within one row"),
    ],
)
def test_a_spoilt_position_is_named(name: str, kind: str, said: str) -> None:
    joints, columns = read_public(name)
    joint = joints[min(1, len(joints) - 1)]
    t, q, command = (np.asarray(columns[key]) for key in ("t", f"q_{joint}", f"q_des_{joint}"))
    q, command = spoilt(kind, t, q, command)
    faults = audit_servos(recording({"t": t, f"q_{joint}": q, f"q_des_{joint}": command})).faults
    assert [said in fault for fault in faults] == [True] * bool(kind), faults


def test_a_factor_that_no_load_explains_is_named() -> None:
    """A drive whose load holds it back by up to 0.08 rad, over a whole turn; and the same with half its position."""
    t = np.arange(0, 20, 0.01)
    command = -1.5 + 2.2 * np.sin(0.9 * t) + 0.8 * np.sin(2.3 * t)
    late = np.interp(t - 0.05, t, command)
    q = late - 0.08 * np.sin(late) + 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    for factor, count in ((1.0, 0), (0.5, 1), (0.65, 1)):
        faults = audit_servos(recording({"t": t, "q_a": factor * q, "q_des_a": command})).faults
        assert len(faults) == count and all("scale of both columns" in fault for fault in faults), (factor, faults)


def chirp(size: float) -> tuple[Array, Array, Array]:
    """Time, position and command of a drive that follows a chirp with a lag of 60 ms and a load; 12-bit encoder."""
    t, step = np.arange(0, 12, 0.01), 2 * np.pi / 4096
    command = size * np.sin(2 * np.pi * (0.1 * t + 0.058 * t**2))
    late = np.interp(t - 0.06, t, command)
    return t, np.round((late - 0.02 * np.sin(late + 0.3)) / step) * step, command


@pytest.mark.parametrize("size", [0.3, 1.0])
@pytest.mark.parametrize("at", [0.35, 0.47, 0.58, 0.72])
def test_a_second_without_new_positions_is_named(size: float, at: float) -> None:
    t, q, command = chirp(size)
    first = round(at * len(t))
    stuck = np.where((np.arange(len(t)) >= first) & (np.arange(len(t)) < first + 100), q[first], q)
    columns = {"t": t, "q_a": stuck, "q_des_a": command}
    faults = audit_servos(recording(columns)).faults
    assert any("stands still" in fault for fault in faults), faults
    assert not audit_servos(recording({**columns, "q_a": q})).faults


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_a_small_drift_over_one_chirp_is_named(size: float) -> None:
    t, q, command = chirp(size)
    [fault] = audit_servos(recording({"t": t, "q_a": q + 0.15 * t / t[-1], "q_des_a": command})).faults
    assert "the zero of q drifts by 0.15 rad" in fault


@PUBLIC
def test_half_a_position_is_named_where_a_load_that_holds_it_back_would_make_it_slow() -> None:
    joints, columns = read_public("bam_sts3250/kp32_sin_time_square.csv.gz")
    half = {**columns, f"q_{joints[0]}": 0.5 * columns[f"q_{joints[0]}"]}
    assert any("of q_des, at every angle" in fault for fault in audit_servos(recording(half)).faults)
