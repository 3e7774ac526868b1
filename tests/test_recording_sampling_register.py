"""Positions in registers that begin again, at any span."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import signid
from signid.recording.sampling import samples, survey
from signid.recording.sampling.accumulate import register_spans
from signid.types import Recording, Robot

SPINDLE = """<robot name="spindle"><link name="base"/><link name="rotor"><inertial><origin xyz="0 0 0"/>
<mass value=".1"/><inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="m" type="{}">
<parent link="base"/><child link="rotor"/><axis xyz="0 0 1"/><limit lower="-900" upper="900" effort="10" velocity="30"/>
</joint></robot>"""
T = np.arange(0, 60, 0.005)
Q = 8 * np.sin(0.6 * T) + 6 * T * (T < 20) + 120 * (T >= 20) + 0.5 * np.sin(4 * T)
NOISE = 1e-4 * np.random.default_rng(0).standard_normal(len(T))


def robot(kind: str = "continuous") -> Robot:
    from signid.robot import robot_from_text

    return robot_from_text(SPINDLE.format(kind), "urdf", "spindle")


def read(q: np.ndarray, kind: str = "continuous") -> tuple[Recording, np.ndarray, tuple[str, ...]]:
    model = robot(kind)
    recording = signid.read_recording({"t": T, "q_m": q, "tau_m": np.cos(T)}, model)
    sampling = survey(recording, model)
    span = sampling.spans[0]
    return recording, samples(recording, sampling, span, 0, sampling.length(span)).q[:, 0], sampling.notes


@pytest.mark.parametrize("span", [25.0, 2 * np.pi, 4 * np.pi, 12.5, 31.7])
@pytest.mark.parametrize("kind", ["continuous", "prismatic"])
def test_a_register_of_any_span_is_unwrapped(span: float, kind: str) -> None:
    low = -span / 2 if kind == "continuous" else -0.3 * span
    wrapped = (Q + NOISE - low) % span + low
    recording, q, notes = read(wrapped, kind)
    assert register_spans(recording)[0] == pytest.approx(span, rel=2e-3)
    shift = q[0] - Q[0]
    np.testing.assert_allclose(q - shift, Q, atol=2e-3 * span if span == 31.7 else 1e-3)
    said = "full turns" if span == 2 * np.pi else f"{span:.3g}"[:3]
    assert any("wraps around by" in note and said in note for note in notes)


def test_motion_steps_and_values_that_drop_out_are_no_wraps() -> None:
    slow = 0.4 * np.sin(0.6 * T) + NOISE
    dropped = slow + 2.0
    dropped[3000:3005] = 0.0
    steps = np.where((T * 2).astype(int) % 2 == 0, 0.0, 1.0) + NOISE
    for q in (slow, dropped, steps, Q + NOISE):
        recording = signid.read_recording({"t": T, "q_m": q, "tau_m": np.cos(T)}, robot())
        assert register_spans(recording)[0] == 0, q[:3]


def test_two_wraps_with_known_parameters() -> None:
    """Inertia 0.02, viscous friction 0.05, Coulomb friction 0.3, in a register of +-12.5 rad."""
    v = 5 * np.sin(0.6 * T) + 2.5 * np.sin(1.7 * T + 1) + 2 * np.sin(4.1 * T)
    q, a = np.cumsum(v) * 0.005, np.gradient(v, T)
    tau = 0.02 * a + 0.05 * v + 0.3 * np.sign(v) + 200 * NOISE
    model = robot()
    columns = {"t": T, "q_m": (q + NOISE + 12.5) % 25 - 12.5, "tau_m": tau}
    found = signid.identify(model, [signid.read_recording(columns, model)], method="wls")
    value = dict(zip(found.base.expressions, found.estimate.value, strict=True))
    assert value["viscous_friction_1"] == pytest.approx(0.05, abs=1e-3)
    assert value["coulomb_friction_1"] == pytest.approx(0.3, abs=5e-3)
    assert value["Izz_1 + armature_1"] == pytest.approx(0.02, abs=5e-4) and found.fit.held_out_r2[0] > 0.999


def test_positions_without_a_jump_are_not_held_in_memory() -> None:
    class Long:
        columns, rows = ("t", "q_m", "tau_m"), 2_000_000

        def read(self, names: tuple[str, ...], start: int, stop: int) -> np.ndarray:
            return np.sin(np.arange(start, min(stop, self.rows)) * 1e-3)[:, None] * np.ones(len(names))

    recording = replace(read(Q)[0], table=Long())
    tracemalloc.start()
    spans = register_spans(recording)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert not spans.any() and peak < 8e6  # 16 MB are those of one column
