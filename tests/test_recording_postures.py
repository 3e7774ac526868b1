"""Static postures, a row each: gravity parameters and friction whose values are known, and what is no posture."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import signid
from signid.cli import run
from signid.errors import RecordingError
from signid.recording import read_recording

ROWS, NOISE, LEVEL = 400, 0.05, 0.8  # rows; [N.m] noise; [N.m] Coulomb level
Columns = dict[str, np.ndarray]


def postures(name: str, level: float = 0.0, seed: int = 0) -> Columns:
    """Postures of a robot by its own gravity, held after an approach from either side; q_J, tau_J and dq_J."""
    robot, rng = signid.load_robot(name), np.random.default_rng(seed)
    low, high = np.clip(robot.lower, -2.5, 2.5), np.clip(robot.upper, -2.5, 2.5)
    q = rng.uniform(low, high, (ROWS, len(robot.joints)))
    approach = rng.choice([-1.0, 1.0], q.shape)
    tau = signid.load_model(robot).gravity(q) + level * approach + NOISE * rng.standard_normal(q.shape)
    kinds = (("q", q), ("tau", tau), ("dq", 0.3 * approach))
    return {f"{kind}_{k}": x for kind, values in kinds for k, x in zip(robot.numbers, values.T, strict=True)}


def without(columns: Columns, kind: str) -> Columns:
    return {name: x for name, x in columns.items() if not name.startswith(f"{kind}_")}


@pytest.mark.parametrize("name", ["3r", "ur5", "panda"])
@pytest.mark.parametrize("stamps", [False, True])
def test_gravity_parameters_are_those_of_the_description(name: str, stamps: bool) -> None:
    columns = without(postures(name), "dq")
    if stamps:  # irregular ones, of seconds
        columns["t"] = np.cumsum(np.random.default_rng(1).uniform(2, 9, ROWS))
    robot = signid.load_robot(name)
    recording = read_recording(columns, robot)
    assert recording.static
    found = signid.identify(robot, recording)
    true = found.base.combination @ stated(found)
    assert np.all(np.abs(found.estimate.value - true) < 4 * found.estimate.std)
    assert not [e for e in found.base.expressions if e.startswith(("Ixx", "Iyy", "Izz", "armature", "viscous"))]
    assert any("Coulomb friction that the residuals at rest allow" in note for note in found.notes)


def stated(found: Any) -> np.ndarray:
    """Standard parameters of the description; 0 for laws, of which it has none."""
    from signid.estimation.standard import stated_parameters

    return np.asarray(stated_parameters(found.session.task).values)


def test_the_level_of_coulomb_friction_follows_from_known_approaches() -> None:
    found = signid.identify("ur5", read_recording(postures("ur5", LEVEL), "ur5"))
    levels = [law.parameters["level"] for law in found.model.laws if law.effect.name == "coulomb_friction"]
    np.testing.assert_allclose(levels, LEVEL, atol=0.02)


def test_without_approaches_the_interval_contains_the_level() -> None:
    found = signid.identify("3r", read_recording(without(postures("3r", LEVEL), "dq"), "3r"))
    assert not [law for law in found.model.laws if law.effect.name == "coulomb_friction"]
    bound = np.sqrt(3) * found.fit.train_rms
    assert np.all(bound > LEVEL)
    assert np.all(bound < 2.5 * LEVEL)


def test_incomplete_rows_are_left_out() -> None:
    columns = postures("3r")
    columns["tau_2"][::10] = np.nan
    recording = read_recording(columns, "3r")
    assert len(recording) == ROWS - ROWS // 10
    assert any("40 incomplete rows are left out" in note for note in recording.notes)


def test_postures_of_a_sweep_are_stated() -> None:
    columns = postures("3r")
    columns["q_1"] = np.linspace(-2, 2, ROWS)
    with pytest.raises(RecordingError, match="no column 't' of time"):
        read_recording(columns, "3r")
    assert read_recording(columns, "3r", rate=0).static


@pytest.mark.parametrize(("period", "rows", "static"), [(2.0, ROWS, True), (8.0, ROWS, True), (2.0, 40 * ROWS, False)])
def test_a_smooth_sweep_with_stamps_of_seconds_is_one_of_postures(period: float, rows: int, static: bool) -> None:
    robot, phase = signid.load_robot("3r"), np.linspace(0, 2 * np.pi, rows)
    q = 2 * np.sin(np.outer(phase, [1, 2, 3]))
    tau = signid.load_model(robot).gravity(q)
    columns = {f"{kind}_{j + 1}": x[:, j] for kind, x in (("q", q), ("tau", tau)) for j in range(3)}
    t = period * np.arange(rows)
    assert read_recording({"t": t, **columns}, robot).static == static  # else it may be in ms
    assert read_recording({"when": t, **columns}, robot, columns={"t": "when"}).static == static


def test_postures_and_motions_are_identified_apart() -> None:
    moving = read_recording({**postures("3r"), "t": np.arange(ROWS) / 100}, "3r", rate=100)
    with pytest.raises(RecordingError, match="identify them apart"):
        signid.identify("3r", [read_recording(postures("3r"), "3r"), moving])


def test_an_arm_that_stands_still_is_said_so(tmp_path: Any, capfd: pytest.CaptureFixture[str]) -> None:
    rng, t = np.random.default_rng(0), np.arange(0, 11, 0.003)
    q = np.c_[0.1 + 4e-4 * (rng.random(len(t)) > 0.5), np.full(len(t), 0.2), -0.3 + 4e-4 * (rng.random(len(t)) > 0.9)]
    table, head = np.c_[t, q, 0.02 * rng.standard_normal(q.shape)], "t,q_1,q_2,q_3,tau_1,tau_2,tau_3"
    np.savetxt(tmp_path / "still.csv", table, "%.7g", ",", header=head, comments="")
    assert run(["check", "3r", str(tmp_path / "still.csv")]) == 3
    said = "".join(capfd.readouterr())
    assert "no joint moves (range 0.0004 rad or m)" in said
    assert "order of time" not in said
