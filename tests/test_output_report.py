"""Numbers have significant digits only, files are written atomically, and JSON is strict."""

from __future__ import annotations

import doctest
import io
import json
import re
import stat
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rich.console import Console, RenderableType
from swing import swing

import signid
from signid.errors import OutputError
from signid.identify import Identification
from signid.output.report import Screen, figure, layout, probe_folder, to_json, with_interval, write_files
from signid.output.report.documents import REPORTED, WRITERS
from signid.output.report.layout import new_table
from signid.output.report.results.identification import (
    identification_document,
    identification_tables,
    inspection_document,
)
from signid.types import Input

INPUTS = [Input("1r", "0" * 64, "description")]


@pytest.fixture(scope="module")
def result() -> Identification:
    robot = signid.load_robot("1r")
    return signid.identify(robot, [signid.read_recording(swing(), robot)])


def shown(renderables: list[RenderableType], width: int = 100) -> str:
    console = Console(width=width, markup=False, highlight=False, color_system=None, record=True, file=io.StringIO())
    console.print(*renderables, sep="\n")
    return console.export_text()


def test_examples_of_numbers() -> None:
    assert doctest.testmod(layout) == (0, doctest.testmod(layout).attempted)
    assert doctest.testmod(layout).attempted >= 4


@given(
    st.floats(-1e9, 1e9, allow_nan=False),
    st.floats(1e-12, 1e9).filter(lambda x: x > 0),
)
def test_the_interval_decides_the_digits(value: float, std: float) -> None:
    shown, half = with_interval(value, std)
    step = 0.06 * 1.96 * std  # two significant digits of the half width, rounded
    resolution = 1e-8 * max(abs(value), 1.96 * std)  # more digits are never shown
    assert abs(float(shown) - value) <= max(step, resolution)
    assert abs(float(half) - 1.96 * std) <= max(step, resolution)
    assert float(shown) != 0 or not shown.startswith("-")
    if 1.96 * std > 1e-6 * abs(value):
        digits = re.sub(r"e.*", "", half).replace(".", "").strip("0")
        assert len(digits) <= 2


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_figure_reads_back(value: float) -> None:
    text = figure(value, 3)
    if not np.isfinite(value):
        assert text == "-"
    else:
        assert float(text) == pytest.approx(value, rel=0.006)
        assert len(text) <= 10


def test_files_appear_whole(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    written = write_files(folder, {"one.json": "{}\n", "two.bin": b"\0\xff", "three.txt": "±\r\n"})
    assert [path.name for path in written] == ["one.json", "two.bin", "three.txt"]
    assert [path.read_bytes() for path in written] == [b"{}\n", b"\0\xff", "±\r\n".encode()]
    assert sorted(path.name for path in folder.iterdir()) == ["one.json", "three.txt", "two.bin"]
    write_files(folder, {"one.json": "new"}, named=True)
    assert written[0].read_text() == "new"


def test_files_have_the_rights_of_any_new_file(tmp_path: Path) -> None:
    (ours,) = write_files(tmp_path, {"ours": ""})
    (tmp_path / "theirs").touch()
    assert stat.S_IMODE(ours.stat().st_mode) == stat.S_IMODE((tmp_path / "theirs").stat().st_mode)


def test_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "model.json").mkdir()
    (tmp_path / "identification.json").write_text("old")
    with pytest.raises(OutputError, match=r"model\.json in it is a folder"):
        write_files(tmp_path, {"identification.json": "new", "model.json": "new"}, named=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["identification.json", "model.json"]
    assert (tmp_path / "identification.json").read_text() == "old"


def test_text_that_cannot_be_encoded_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(UnicodeEncodeError):
        write_files(tmp_path / "new", {"fine": "fine", "broken": "\ud800"})
    assert list(tmp_path.iterdir()) == []


def test_a_probe_leaves_nothing(tmp_path: Path) -> None:
    probe_folder(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").touch()
    for place in ("file", "file/below"):
        with pytest.raises(OutputError, match="file is a file; name a folder"):
            probe_folder(tmp_path / place)
    (tmp_path / "nowhere").symlink_to(tmp_path / "gone")
    with pytest.raises(OutputError, match="nowhere"):
        probe_folder(tmp_path / "nowhere")


def test_json_is_strict() -> None:
    text = to_json(
        {"a": [np.inf, -np.inf, np.nan, 1.5], "b": {"c": (1, np.float64(np.nan))}, "d": np.arange(2), "é": None}
    )
    assert json.loads(text) == {"a": [None, None, None, 1.5], "b": {"c": [1, None]}, "d": [0, 1], "é": None}
    assert text.endswith("}\n") and "é" in text


def test_standard_parameters_reproduce_the_base_parameters(result: Identification) -> None:
    found = identification_document(result)
    link = found["standard_parameters"]["link_1"]
    effects = [number["value"] for entry in found["effects"] for number in entry["parameters"].values()]
    standard = np.array([link["mass"], *link["first_moment"], *link["inertia"], *effects])
    values = [entry["value"] for entry in found["base_parameters"]]
    np.testing.assert_allclose(result.base.combination @ standard, values, rtol=1e-12, atol=1e-12)


def test_a_coefficient_has_an_interval_where_it_shows_alone(result: Identification) -> None:
    found = {entry["effect"]: entry for entry in identification_document(result)["effects"]}
    base = {entry["expression"]: entry for entry in identification_document(result)["base_parameters"]}
    assert found["viscous_friction"]["joint"] == "joint_1"
    coefficient = found["viscous_friction"]["parameters"]["coefficient"]
    assert coefficient["std"] == base["viscous_friction_1"]["std"] and coefficient["unit"] == "N.m.s/rad"
    assert found["armature"]["parameters"]["inertia"]["std"] is None


def test_prismatic_joints_have_their_units() -> None:
    robot = signid.load_robot("emps")
    found = inspection_document(signid.inspect(robot), INPUTS)
    assert found["joints"][0]["type"] == "prismatic" and found["joints"][0]["unit"] == "m"
    assert {"kg", "N.s/m", "N"} == {entry["unit"] for entry in found["base_parameters"]}


@pytest.mark.parametrize("width", [40, 60, 80, 100])
def test_narrow_tables_keep_all_numbers_and_every_row_a_name(width: int) -> None:
    names = ["left_ankle_pitch_joint", "right_shoulder_roll_joint"]
    numbers = ["0.0003 ± 0.0044", "0.000009 ± 0.000079", "-0.000026 ± 0.000078", "(0.00104)"]
    heads = ["viscous friction [N.m.s/rad]>", "coulomb friction [N.m]>", "torque offset [N.m]>", "armature>"]
    table = new_table("joint", *heads, rows=[[name, *numbers] for name in names])
    screen = io.StringIO()
    Console(width=width, file=screen, markup=False).print(table)
    lines = screen.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert all(sum(number in line for line in lines) == 2 for number in numbers)
    rows = [line for line in lines if any(number in line for number in numbers)]
    assert all(re.match(rf"(left|right)\w*…?\w*{'joint'[1:]} ", row) for row in rows), lines


def test_brackets_in_names_stay(result: Identification) -> None:
    named = replace(result, robot=replace(result.robot, name="[red]arm[/red]"), notes=("see [bold]this[/bold]",))
    text = shown(identification_tables(named))
    assert "[red]arm[/red]" in text and "note: see [bold]this[/bold]" in text


def test_infeasible_numbers_are_reported(result: Identification) -> None:
    values = result.parameters.values.copy()
    values[0] = -1.0
    impossible = replace(result, parameters=replace(result.parameters, values=values), method="wls")
    assert "The inertials are not physically consistent" in shown(identification_tables(impossible))


def test_the_screen_is_plain_where_it_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    screen = Screen()
    assert screen.width == 100
    screen.write("as [it] stands :smile:\n")
    screen.print("[bold]and[/bold] 0.5")
    assert capsys.readouterr().out == "as [it] stands :smile:\n[bold]and[/bold] 0.5\n"


def test_every_writer_of_a_result_exists() -> None:
    for kind, (module, start) in WRITERS.items():
        functions = vars(import_module(f"signid.output.report.results.{module}"))
        verbs = ("document", "tables", "page") if kind in (*REPORTED, "ServoAudit") else ("document", "tables")
        assert all(callable(functions[f"{start}_{verb}"]) for verb in verbs), kind
