"""Units, scales and names of joints in a column map, and the maps that are drafted for other names."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_recording import TAU, Q, T, arm, whole
from test_recording_formats import refusal, sentence

import signid
from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.reading import draft_map
from signid.recording.vocabulary import change_of
from signid.simulation.plant import read_motion
from signid.types import Recording, Robot

EXACT = {  # by hand: (kind, unit) -> what one of it is
    ("t", "ms"): 0.001,
    ("t", "us"): 1e-6,
    ("t", "ns"): 1e-9,
    ("q", "deg"): np.pi / 180,
    ("q", "mrad"): 0.001,
    ("q", "rev"): 2 * np.pi,
    ("q", "mm"): 0.001,
    ("dq", "deg/s"): np.pi / 180,
    ("dq", "rpm"): 2 * np.pi / 60,
    ("ddq", "mm/s2"): 0.001,
    ("tau", "mN.m"): 0.001,
    ("tau", "N.cm"): 0.01,
    ("tau", "kgf.cm"): 0.0980665,
    ("tau", "kN"): 1000.0,
    ("abs_current", "mA"): 0.001,
}


def read(source: Any, columns: Any, robot: Robot | None = None) -> Recording:
    return read_recording(source, robot or arm(), columns=columns)


@pytest.mark.parametrize(("kind", "unit"), EXACT)
def test_factors_are_exact(kind: str, unit: str) -> None:
    change = change_of(unit, kind, None, "it")
    assert change.scale / change.over == pytest.approx(EXACT[kind, unit], rel=1e-15) and change.offset == 0
    assert change_of(unit.replace(".", ""), kind, None, "it") == change


def test_units_by_column_and_by_kind(tmp_path: Path) -> None:
    source = {
        "stamp": (T * 1e9).astype(np.int64),
        "e": np.degrees(Q[:, 1]),
        "m": TAU[:, 1] * 1e3,
        "q_3": np.degrees(Q[:, 2]),
    }
    text = """
t = { column = "stamp", unit = "ns" }
q_elbow = { column = "e" }
tau_elbow = { column = "m", unit = "mNm" }
[units]
q = "deg"
"""
    (tmp_path / "map.toml").write_text(text)
    samples = read(source, tmp_path / "map.toml").read()
    np.testing.assert_allclose(samples.t, T, rtol=1e-15)
    np.testing.assert_allclose(samples.q, Q[:, 1:], rtol=1e-15, atol=1e-17)
    np.testing.assert_allclose(samples.tau[:, 0], TAU[:, 1], rtol=1e-15)
    own = {
        "units": {"q": "deg"},
        "q_1": {"column": "x", "unit": "rad"},
        "q_2": {"column": "y", "scale": -2, "offset": 1},
    }
    found = read({"t": T, "x": Q[:, 0], "y": Q[:, 1], "tau": TAU}, own).read().q
    np.testing.assert_array_equal(found, np.column_stack([Q[:, 0], 1 - 2 * Q[:, 1]]))


def test_currents_and_prismatic_joints() -> None:
    slide = replace(arm(constants=2.0), prismatic=np.array([True, False, False]))
    source = {"t": T, "q_1": 1e3 * Q[:, 0], "current_1": 1e3 * TAU[:, 0]}
    samples = read(source, {"units": {"q": "mm", "current": "mA"}}, slide).read()
    np.testing.assert_allclose(samples.q[:, 0], Q[:, 0], rtol=1e-14)
    np.testing.assert_allclose(samples.tau[:, 0], 2 * TAU[:, 0], rtol=1e-14)
    with refusal("'q_1'", "'mm'", "revolute", "deg"):
        read(whole(), {"units": {"q": "mm"}})


def test_joints_by_a_pattern_and_by_a_table() -> None:
    source = {"t": T}
    for j, name in enumerate(arm().joints):
        source |= {f"q_left/{name}_joint": Q[:, j], f"tau_left/{name}_joint": TAU[:, j], f"q_right/{name}_joint": T}
    for columns in ({"joints": "left/*_joint"}, {"joints": {name: f"left/{name}_joint" for name in arm().joints}}):
        recording = read(source, columns)
        np.testing.assert_array_equal(recording.read().q, Q)
        np.testing.assert_array_equal(recording.read().tau, TAU)
        (note,) = recording.notes
        sentence(note, "q_right/shoulder_joint", "ignored")
    with refusal("q_left/shoulder_joint names no joint", "numbered"):
        read(source, None)


BAD: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "unknown unit": ({"q_1": {"column": "q_2", "unit": "furlong"}}, ("furlong", "'q_2'", "deg")),
    "unit of another kind": ({"tau_1": {"column": "tau_2", "unit": "A"}}, ("'A'", "N.m")),
    "unknown unit of a kind": ({"units": {"q": "furlong"}}, ("furlong", "deg")),
    "unit of no kind": ({"units": {"elbow": "deg"}}, ("'elbow'", "q_des")),
    "unit in a list": ({"units": {"q": ["deg"]}}, ("deg", "'q'")),
    "units as a word": ({"units": "deg"}, ("'deg'", "[units]")),
    "unit that is a number": ({"q_1": {"column": "q_2", "unit": 3}}, ("q_1", "3")),
    "no column": ({"q_1": {"unit": "deg"}}, ("q_1", "column")),
    "strange word": ({"q_1": {"column": "q_2", "units": "deg"}}, ("'units'", "offset")),
    "unit and scale": ({"q_1": {"column": "q_2", "unit": "deg", "scale": 2}}, ("q_1", "not both")),
    "scale zero": ({"q_1": {"column": "q_2", "scale": 0}}, ("q_1", "scale")),
    "scale in words": ({"q_1": {"column": "q_2", "scale": "big"}}, ("q_1", "scale")),
    "offset infinite": ({"q_1": {"column": "q_2", "offset": float("inf")}}, ("q_1", "offset")),
    "pattern without a star": ({"joints": "left_"}, ("'left_'", "left_arm/*")),
    "pattern of two stars": ({"joints": "*_*"}, ("'*_*'",)),
    "joints in a list": ({"joints": ["a"]}, ("joints", "[joints]")),
    "one name for two joints": ({"joints": {"shoulder": "a", "elbow": "a"}}, ("two joints",)),
}


@pytest.mark.parametrize("case", BAD)
def test_maps_that_make_no_sense(case: str) -> None:
    columns, culprits = BAD[case]
    with refusal(*culprits):
        read(whole(), columns)


OFFERED: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "all fit": (("t", "q_1", "q_elbow", "q_3", "tau_1"), ()),
    "nothing alike": (("t", "volts", "mode"), ()),
    "prefix": (
        ("t", "q_r1/shoulder", "q_r1/elbow", "q_r1/wrist", "tau_r1/elbow"),
        (
            'q_shoulder = "q_r1/shoulder"',
            'q_elbow = "q_r1/elbow"',
            'q_wrist = "q_r1/wrist"',
            'tau_elbow = "tau_r1/elbow"',
        ),
    ),
    "suffix": (("t", "q_shoulder.pos", "q_elbow.pos"), ('q_shoulder = "q_shoulder.pos"', 'q_elbow = "q_elbow.pos"')),
    "the arm with more joints": (
        ("q_b/elbow", "q_a/elbow", "q_a/wrist", "t"),
        ('q_elbow = "q_a/elbow"', 'q_wrist = "q_a/wrist"'),
    ),
    "misspelt": (("t", "q_Shoulder_A", "q_Elbow", "q_3"), ('q_shoulder = "q_Shoulder_A"', 'q_elbow = "q_Elbow"')),
    "another language": (("t", "q_Schulter", "q_x y"), ('q_shoulder = "q_Schulter"',)),
    "words": (
        ("time_ms", "elbow_position_deg", "elbowTorque", "elbow_cmd_pos", "wrist velocity", "wrist_torque_cmd"),
        (
            't = { column = "time_ms", unit = "ms" }',
            'q_elbow = { column = "elbow_position_deg", unit = "deg" }',
            'dq_wrist = "wrist velocity"',
            'tau_elbow = "elbowTorque"',
            'q_des_elbow = "elbow_cmd_pos"',
        ),
    ),
    "numbers": (
        ("timestamp", "joint1_pos", "joint3_pos"),
        ('t = "timestamp"', 'q_shoulder = "joint1_pos"', 'q_wrist = "joint3_pos"'),
    ),
    "numbers from zero": (("t", "pos[0]", "pos[1]"), ('q_shoulder = "pos[0]"', 'q_elbow = "pos[1]"')),
}


@pytest.mark.parametrize("case", OFFERED)
def test_possible_maps_are_offered(case: str) -> None:
    columns, lines = OFFERED[case]
    drafted = {line.signal: line for line in draft_map({name: T for name in columns}, arm()).lines}
    for key, value in tomllib.loads("\n".join(lines)).items():
        column, unit = (value, "") if isinstance(value, str) else (value["column"], value["unit"])
        assert drafted[key].guess.column == column and drafted[key].guess.unit == unit


def test_arrays_with_other_names_are_read_by_a_drafted_map() -> None:
    source = {"time_us": T * 1e6, "shoulder.pos deg": np.degrees(Q[:, 0]), 'shoulder "effort"': TAU[:, 0]}
    samples = read(source, None).read()
    np.testing.assert_allclose(samples.t, T, rtol=1e-14)
    np.testing.assert_allclose(samples.q[:, 0], Q[:, 0], rtol=1e-14, atol=1e-17)
    np.testing.assert_array_equal(samples.tau[:, 0], TAU[:, 0])


def test_the_map_in_the_readme_reads(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "signid" / "recording" / "README.md").read_text()
    (tmp_path / "map.toml").write_text("t = { column" + text.partition("```toml\nt = { column")[2].partition("```")[0])
    source = {"stamp": T * 1e9, "elbow_pos": np.degrees(Q[:, 1]), "wrist": Q[:, 2]}
    source |= {"q_left_arm/shoulder": Q[:, 0], "tau_left_arm/shoulder": TAU[:, 0] * 1e3}
    samples = read(source, tmp_path / "map.toml").read()
    np.testing.assert_allclose(samples.q, np.column_stack([Q[:, :2], 0.011 * Q[:, 2] - 0.3]), rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(samples.tau[:, 0], TAU[:, 0], rtol=1e-14)


def test_motions_know_units_of_dates() -> None:
    motion = read_motion({"t": np.datetime64("2026-01-01", "ns") + (T * 1e9).astype("timedelta64[ns]"), "q": Q}, arm())
    np.testing.assert_allclose(motion.t, T, atol=1e-9)


def test_kinds_of_columns_may_be_written_in_capitals() -> None:
    robot = signid.load_robot("1r")
    t = np.arange(0, 2, 0.01)
    columns = {"T": t, "Q_1": np.sin(t), "TAU_1": np.cos(t)}
    read = signid.read_recording(columns, robot)
    assert (read.columns["t"], read.columns["q"], read.columns["tau"]) == (("T",), ("Q_1",), ("TAU_1",))
    with pytest.raises(RecordingError, match="has q_1 and Q_1, which are the same signal"):
        signid.read_recording({"t": t, "q_1": t, "Q_1": t, "tau_1": t}, robot)
