"""Closed streams, strange names, pipes, bombs and foreign modules: a sentence and exit code 2, or the usual result."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from swing import csv, swing

from signid.cli import run
from signid.cli.fleet.run import Order, spread
from signid.errors import ManifestError, RecordingError
from signid.recording.formats import find_format

HERE = Path(__file__).parents[1]
THERE = {**os.environ, "PYTHONPATH": str(HERE), "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
posix = pytest.mark.skipif(os.name != "posix", reason="shell of POSIX systems")


@pytest.mark.slow_cases("inspect nothing")
@posix
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(("command", "code"), [("inspect 1r", 0), ("inspect nothing", 2)])
def test_closed_streams(closed: str, command: str, code: int, tmp_path: Path) -> None:
    line = f"{sys.executable} -m signid {command} {closed}"
    assert subprocess.run(line, shell=True, cwd=tmp_path, env=THERE, capture_output=True).returncode == code


@pytest.mark.skipif(sys.platform != "linux", reason="file names of any bytes")
def test_file_names_that_are_not_utf_8(tmp_path: Path) -> None:
    (Path(os.fsdecode(os.fsencode(tmp_path) + b"/r\xff.csv"))).write_text(csv(swing()))
    command = [sys.executable, "-m", "signid", "identify", "1r", b"r\xff.csv", "-o", "out"]
    done = subprocess.run(command, cwd=tmp_path, env=THERE, capture_output=True)
    assert done.returncode in (0, 3), done.stderr
    assert (tmp_path / "out/identification.json").is_file()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="file names of any bytes")
def test_names_that_are_not_utf_8_are_replaced_wherever_they_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    bad = os.fsdecode(b"r\xff")
    Path(f"{bad}.csv").write_text(csv(swing()))
    Path(f"{bad}.urdf").write_text((HERE / "robots/1r/robot.urdf").read_text())
    Path(f"{bad}.list.csv").write_text("robot,recording,session,task\n1r,plain.csv,one,identify\n")
    Path("plain.csv").write_text(csv(swing()))
    for command in (
        f"check {bad}.urdf {bad}.csv --json",
        f"identify {bad}.urdf {bad}.csv -o identified",
        f"diagnose {bad}.urdf {bad}.csv -o diagnosed",
        f"validate {bad}.urdf {bad}.csv -o validated",
        f"replay {bad}.urdf {bad}.csv --html replay.html --duration 1",
        f"simulate {bad}.urdf --duration 1 --json",
        f"convert {bad}.csv --robot {bad}.urdf -o {bad}.out.csv",
        f"fleet {bad}.list.csv -o fleet --workers 1",
    ):
        assert run(command.split()) in (0, 3), (command, capfd.readouterr().err)
    assert run(["check", "1r", f"{bad}x.csv"]) == 2
    assert "recording r\ufffdx.csv does not exist" in capfd.readouterr().err
    texts = {path: path.read_text("utf-8") for path in tmp_path.rglob("*") if path.suffix in (".json", ".html")}
    for name in (
        "identified/identification.json diagnosed/diagnosis.json validated/validation.json identified/report.html "
        "diagnosed/report.html validated/report.html replay.html"
    ).split():
        assert "r\ufffd.csv" in texts[tmp_path / name], name
    assert '"path": "r\ufffd.list.csv"' in texts[tmp_path / "fleet/fleet.json"]


def test_unknown_users(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["inspect", "~nosuchuser/x.urdf"]) == 2
    assert "there is no file ~nosuchuser" in capfd.readouterr().err


@pytest.mark.parametrize(
    "error", [np.linalg.LinAlgError("singular"), IndexError("7"), OverflowError("x"), StopIteration()]
)
def test_calculations_without_a_result_name_the_files(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    (tmp_path / "r.csv").write_text(csv(swing()))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("signid.robot.load_robot", fail)
    assert run(["check", "1r", "r.csv"]) == 2
    said = capfd.readouterr().err
    assert "numbers of r.csv" in said and type(error).__name__ in said and len(said.splitlines()) == 1
    monkeypatch.setenv("SIGNID_DEBUG", "1")
    assert run(["check", "1r", "r.csv"]) == 2
    assert "Traceback" in capfd.readouterr().err


def test_bombs_are_refused(tmp_path: Path) -> None:
    for name, content in {
        "a.csv.gz": gzip.compress(b"\n" * 50_000_000, 1),
        "b.csv.gz": gzip.compress(b"t,q_1,tau_1\n0,0,0\n" + b"\n" * 50_000_000, 1),
        "c.csv": b"," * 1_000_000 + b"\n",
        "d.csv": b"t" + b",a" * 30_000 + b"\n",
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordingError):
            find_format(tmp_path / name).open(tmp_path / name)


@posix
def test_pipes_are_not_read(tmp_path: Path) -> None:
    from signid.cli.fleet import manifest
    from signid.recording.source import digest_of

    os.mkfifo(tmp_path / "p.csv")
    with pytest.raises(ManifestError, match="no regular file"):
        manifest.read_manifest(tmp_path / "p.csv")
    for digest in (lambda path: manifest.digest(path, "p"), digest_of):
        with pytest.raises(RecordingError, match="regular file|cannot be read"):
            digest(tmp_path / "p.csv")
    for name in ("p.csv", "p.npz"):  # a hang before, since every file might hold factors
        (tmp_path / "p.npz").exists() or os.mkfifo(tmp_path / "p.npz")
        assert run(["identify", "1r", str(tmp_path / name), "--json"]) == 2


def test_workers_import_nothing_beside_the_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("open('run', 'w').write('x'); raise SystemExit")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f".{os.pathsep}{os.pathsep}{HERE}")
    ((_, answer),) = spread([Order(("inspect", "nothing"), str(tmp_path))], workers=1)
    assert answer.code == 2 and not (tmp_path / "run").exists(), answer
