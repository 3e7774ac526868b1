"""Velocities without positions: integrated where no torque depends on the position; numbers known in advance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import signid
from signid.errors import RecordingError
from signid.recording import read_recording

INERTIA, VISCOUS, STEP = 2e-4, 3e-4, 0.01  # kg.m2, N.m.s/rad, s
MOTOR = """<robot name="motor"><link name="base"/><link name="rotor"><inertial><mass value="0.05"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shaft" type="continuous"><parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.fixture
def motor(tmp_path: Path) -> Path:
    path = tmp_path / "motor.urdf"
    path.write_text(MOTOR)
    return path


def test_a_free_motor_by_its_speed(motor: Path) -> None:
    rng, t = np.random.default_rng(0), np.arange(0, 20, STEP)
    parts = [(rng.uniform(5, 40), rng.uniform(0.5, 8), rng.uniform(0, 6)) for _ in range(4)]
    v = sum(size * np.sin(w * t + phase) for size, w, phase in parts)
    a = sum(size * w * np.cos(w * t + phase) for size, w, phase in parts)
    tau = INERTIA * a + VISCOUS * v + 1e-5 * rng.standard_normal(len(t))
    recording = read_recording({"t": t, "dq_shaft": v, "tau_shaft": tau}, motor)
    assert any("positions of shaft are integrated from velocities" in note for note in recording.notes)
    found = signid.identify(motor, recording)
    numbers = {name: value for name, value in zip(found.base.expressions, found.estimate.value, strict=True)}
    inertia = next(value for name, value in numbers.items() if name.startswith("Izz"))
    viscous = next(value for name, value in numbers.items() if name.startswith("viscous"))
    assert inertia == pytest.approx(INERTIA, rel=0.01)
    assert viscous == pytest.approx(VISCOUS, rel=0.05)


def test_a_missing_speed_stays_a_missing_position(motor: Path) -> None:
    t = np.arange(0, 2, STEP)
    v = np.cos(t)
    v[50:80] = np.nan
    q = read_recording({"t": t, "dq_shaft": v, "tau_shaft": v}, motor).read().q[:, 0]
    np.testing.assert_array_equal(np.isnan(q), np.isnan(v))
    np.testing.assert_allclose(q[:50], np.sin(t[:50]), atol=1e-4)


def test_the_first_joint_of_an_upright_arm_alone_is_free_of_weight() -> None:
    t = np.arange(0, 2, STEP)
    signals = {f"{kind}_{k}": np.cos((k + 1) * t) for kind in ("dq", "tau") for k in range(1, 7)}
    first = {"t": t, **signals, **{f"q_{k}": np.sin(t) for k in range(2, 7)}}
    assert len(read_recording(first, "ur5").joints) == 6
    with pytest.raises(RecordingError, match="has no position column"):
        read_recording({"t": t, "dq_2": np.cos(t), "tau_2": np.cos(t)}, "ur5")


def test_a_voltage_is_no_torque(motor: Path) -> None:
    t = np.arange(0, 2, STEP)
    with pytest.raises(RecordingError, match="a voltage is no torque"):
        read_recording({"t": t, "dq_shaft": np.cos(t), "volt_shaft": np.cos(t)}, motor)


def test_a_strangers_motor_test_is_read_by_its_names(motor: Path, tmp_path: Path) -> None:
    t = np.arange(0, 2, STEP)
    columns = [t, 3 * np.sin(5 * t), 0.01 * np.cos(5 * t)]
    for last in ("torque", "output_voltage"):
        head = f"timestamp,angular_velocity,{last}"
        np.savetxt(tmp_path / f"{last}.csv", np.column_stack(columns), delimiter=",", header=head, comments="")
    read = read_recording(tmp_path / "torque.csv", motor).read()
    np.testing.assert_allclose(read.q[:, 0], 0.6 * (1 - np.cos(5 * t)), atol=2e-3)
    with pytest.raises(RecordingError, match="a voltage is no torque"):
        read_recording(tmp_path / "output_voltage.csv", motor)
