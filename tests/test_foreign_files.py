"""Files that signid did not write stay as they are, whatever folder is named for results."""

from __future__ import annotations

import shutil
from pathlib import Path

import polars as pl
import pytest

from signid.cli import run

ROBOT = Path(__file__).parents[1] / "robots" / "3r"
SINGLE = {  # command -> files that it writes
    "identify robot.urdf recording.parquet --method wls": "identification.json model.json robot.urdf report.html",
    "identify robot.urdf recording.parquet --unsigned": "signed.csv signs.html",
    "diagnose robot.urdf recording.parquet": "diagnosis.json model.json robot.urdf report.html",
    "validate robot.urdf recording.parquet": "validation.json report.html",
    "demo": "demo.json recording.csv held_out.csv diagnosis.json model.json robot.urdf report.html replay.html",
}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot, a recording and other files of the user."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROBOT / "robot.urdf", tmp_path)
    pl.read_parquet(ROBOT / "recording.parquet")[:2500].write_parquet(tmp_path / "recording.parquet")
    (tmp_path / "notes.txt").write_text("mine")
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("command", "file"), [(command, file) for command, files in SINGLE.items() for file in files.split()]
)
def test_a_foreign_file_of_the_same_name_is_kept(
    command: str, file: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = place / "out"
    folder.mkdir()
    (folder / file).write_text('{"mine": 1}')
    before = content(place)
    assert run([*command.split(), "-o", "out"]) == 2
    said = capsys.readouterr().err
    assert f"{file} in it was not written by signid" in said and said.count("\n") == 1
    assert content(place) == before


@pytest.mark.slow_cases("diagnose")
@pytest.mark.parametrize("command", list(SINGLE)[:4])
def test_results_beside_the_users_files_leave_them_alone_and_are_replaced(command: str, place: Path) -> None:
    (place / "robot.urdf").rename(place / "arm.urdf")
    mine = content(place)
    for _ in range(2):
        assert run([*command.replace("robot.urdf", "arm.urdf").split(), "-o", "."]) in (0, 3)
        assert {name: data for name, data in content(place).items() if name in mine} == mine


def test_the_users_description_is_not_replaced_by_a_result(place: Path) -> None:
    before = content(place)
    assert run("identify robot.urdf recording.parquet -o .".split()) == 2
    assert content(place) == before


@pytest.mark.parametrize(
    "command",
    [
        "simulate 3r --motion recording.parquet -o recording.parquet",
        "simulate 3r --motion recording.parquet -o ./recording.parquet",
        "convert recording.parquet -o recording.parquet",
        "export robot.urdf --urdf robot.urdf",
        "export . --mjcf ./robot.urdf",
        "export robot.urdf --c arm.c --function actuators.toml",
        "simulate robot.urdf -o table.csv --actuators table.csv",
        "excite robot.urdf -o table.csv --actuators table.csv",
        "convert recording.parquet --columns table.csv -o table.csv",
        "replay robot.urdf recording.parquet --columns page.html --html page.html",
    ],
)
def test_a_file_that_is_read_is_not_written(command: str, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("actuators.toml", "table.csv", "page.html"):
        (place / name).write_text("")
    before = content(place)
    assert run(command.split()) == 2
    said = capsys.readouterr().err
    assert "is read by this command" in said or "the file to convert" in said
    assert said.count("\n") == 1 and content(place) == before


@pytest.mark.parametrize("name", ["arm.h", "arm_test.c"])
def test_files_beside_an_exported_one_replace_no_foreign_file(
    name: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (place / name).write_text("int mine;\n")
    before = content(place)
    assert run("export 3r --c arm.c".split()) == 2
    said = capsys.readouterr().err
    assert f"{name} in it was not written by signid" in said and said.count("\n") == 1 and content(place) == before
    (place / name).unlink()
    for _ in range(2):
        assert run("export 3r --c arm.c".split()) == 0
    assert run("export 3r --c other.c --arrays other_test.c".split()) == 2


MANIFEST = "robot,recording,session,task\n3r,sessions/arm_17/recording.parquet,arm_17,identify\n"


@pytest.fixture
def manifest(place: Path) -> Path:
    """A manifest whose recordings lie where its sessions would be written."""
    (place / "sessions" / "arm_17").mkdir(parents=True)
    (place / "recording.parquet").rename(place / "sessions" / "arm_17" / "recording.parquet")
    (place / "manifest.csv").write_text(MANIFEST)
    return place / "manifest.csv"


def test_a_fleet_does_not_replace_recordings_in_the_folder_of_a_session(manifest: Path, place: Path) -> None:
    (place / "sessions" / "arm_17" / "notes.txt").write_text("mine")
    before = content(place)
    assert run("fleet manifest.csv -o . --workers 1".split()) in (0, 3)
    after = content(place)
    assert before.items() <= after.items() and "sessions/arm_17/identification.json" in after


@pytest.mark.parametrize("file", ["fleet.json", "index.html"])
def test_a_fleet_does_not_replace_a_foreign_summary(file: str, manifest: Path, place: Path) -> None:
    (place / "out").mkdir()
    (place / "out" / file).write_text("mine")
    before = content(place)
    assert run("fleet manifest.csv -o out --workers 1".split()) == 2
    assert content(place) == before


@pytest.mark.parametrize("record", ["", "{}", '{"files": ["recording.parquet", "notes.txt"]}'])
def test_a_session_folder_with_a_foreign_record_is_kept(record: str, manifest: Path, place: Path) -> None:
    (place / "sessions" / "arm_17" / "session.json").write_text(record)
    before = content(place)
    assert run("fleet manifest.csv -o . --workers 1".split()) == 2
    assert content(place) == before


@pytest.mark.slow
def test_a_fleet_replaces_its_own_sessions_and_keeps_an_added_file(manifest: Path, place: Path) -> None:
    assert run("fleet manifest.csv -o out --workers 1".split()) in (0, 3)
    (place / "out" / "sessions" / "arm_17" / "notes.txt").write_text("mine")
    (place / "manifest.csv").write_text(MANIFEST.replace("identify", "diagnose"))
    assert run("fleet manifest.csv -o out --workers 1".split()) in (0, 3)
    names = {path.name for path in (place / "out" / "sessions" / "arm_17").iterdir()}
    assert {"diagnosis.json", "notes.txt"} <= names and "identification.json" not in names
