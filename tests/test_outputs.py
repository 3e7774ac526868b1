"""Every command that writes: into folders with unusual names, into read-only folders, and on a full disk."""

from __future__ import annotations

import errno
import os
import re
import shlex
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from serving import TEXT, register, serve, toy
from swing import csv, swing
from typer.main import get_command

from signid.cli import run
from signid.cli.app import app

HERE = Path(__file__).parents[1]
STRANGE = "a folder é 日本 'x' %20 #1 [y]"
XACRO = """<robot name="ö" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="ein Teil ü/arm é.xacro"/></robot>"""
ROBOT, RECORDING, OUT = "'mein Arm ö.xacro'", "'ä b.csv'", "'aus gabe ß'"
COMMANDS = {
    "check": f"check {ROBOT} {RECORDING} -o {OUT}",
    "identify": f"identify {ROBOT} {RECORDING} -o {OUT}",
    "diagnose": f"diagnose {ROBOT} {RECORDING} -o {OUT}",
    "validate": f"validate {ROBOT} {RECORDING} -o {OUT}",
    "convert": f"convert {RECORDING} -o {OUT}/é.parquet",
    "excite": f"excite {ROBOT} --duration 3 --kind random -o {OUT}/é.csv",
    "export": f"export {ROBOT} --urdf {OUT}/é.urdf --mjcf {OUT}/é.xml --function {OUT}/é.py --ros {OUT}/é.yaml",
    "simulate": f"simulate {ROBOT} --duration 2 -o {OUT}/é.csv.gz",
    "replay": f"replay {ROBOT} {RECORDING} --html {OUT}/é.html",
    "fleet": f"fleet 'flotte ñ.csv' -o {OUT}",
    "data": f"data toy --yes --source ADDRESS -o {OUT}",
    "demo": f"demo --robot 1r --no-open -o {OUT}",
}
SILENT = {"inspect", "effects", "payload", "watch"}  # commands that write no file


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot of two files, a recording of it and a manifest, all with unusual names."""
    place = tmp_path / STRANGE
    (place / "ein Teil ü").mkdir(parents=True)
    part = (HERE / "robots/1r/robot.urdf").read_text(encoding="utf-8")
    (place / "ein Teil ü/arm é.xacro").write_text(part, encoding="utf-8")
    (place / "mein Arm ö.xacro").write_text(XACRO, encoding="utf-8")
    (place / "ä b.csv").write_text(csv(swing()), encoding="utf-8")
    rows = "robot,recording,name,task\nmein Arm ö.xacro,ä b.csv,tag é 1,identify\n"
    (place / "flotte ñ.csv").write_text(rows, encoding="utf-8")
    monkeypatch.chdir(place)
    register(toy(), monkeypatch)
    return place


def carried_out(command: str) -> int:
    with serve({"logs/a_toy.csv": TEXT}) as server:
        return run(shlex.split(COMMANDS[command].replace("ADDRESS", server.address)))


def names(place: Path) -> set[str]:
    return {path.relative_to(place).as_posix() for path in place.rglob("*")}


@contextmanager
def read_only(place: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Make a folder read-only even for a superuser, whom file permissions do not bind."""
    known, made = os.open, os.mkdir

    def refuse(path: Any) -> None:
        if isinstance(path, str | os.PathLike) and Path(path).absolute().is_relative_to(place):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), path)

    def opened(path: Any, flags: int, *args: Any, **more: Any) -> int:
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            refuse(path)
        return known(path, flags, *args, **more)

    def folder(path: Any, *args: Any, **more: Any) -> None:
        refuse(path)
        made(path, *args, **more)

    with monkeypatch.context() as broken:
        broken.setattr(os, "open", opened)
        broken.setattr(os, "mkdir", folder)
        yield


@contextmanager
def full() -> Iterator[None]:
    """Make every write fail as on a full disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_every_command_that_writes_is_here() -> None:
    commands: Any = get_command(app)
    assert set(commands.commands) == {*COMMANDS, *SILENT}


@pytest.mark.slow_cases("demo")
@pytest.mark.parametrize("command", COMMANDS)
def test_strange_names_are_fine(command: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = names(folder)
    code = carried_out(command)
    assert code in (0, 3), capsys.readouterr().err
    assert names(folder) - before and not [name for name in names(folder) if ".signid-" in name]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_read_only_folder_is_reported(
    command: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = names(folder)
    with read_only(folder, monkeypatch):
        assert carried_out(command) == 2
    output = capsys.readouterr().err
    assert "Read-only" in output and len(output.splitlines()) == 1, output
    assert names(folder) == before


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_is_reported(command: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = names(folder)
    with full():
        assert carried_out(command) == 2
    output = capsys.readouterr().err
    assert "File too large" in output and len(output.splitlines()) == 1, output
    assert not [name for name in names(folder) - before if (folder / name).is_file()]


NAMED = {
    "export": "export {robot} --urdf a.urdf --function b.py --c c.c",
    "excite": "excite {robot} --duration 3 --kind random -o a.csv",
    "simulate": "simulate {robot} --duration 2 -o a.csv",
    "convert": "convert {recording} -o a.csv",
    "replay": "replay {robot} {recording} --html a.html --mcap b.mcap --rrd c.rrd",
    "watch": "watch {robot} {recording} --quiet 1 --mcap a.mcap --rrd b.rrd --save c.json",
    "identify": "identify {robot} {recording} -o a",
    "check": "check {robot} {recording} -o a",
}
SPECIAL = ("pipe", "node", "open file")


def make_special(kind: str, path: Path) -> None:
    """Make a pipe, a null device of our own, or a link to our standard output."""
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "node":
        if os.geteuid() != 0:
            pytest.skip("only a superuser makes devices")
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))
    else:
        path.symlink_to("/proc/self/fd/1")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes in folders")
@pytest.mark.parametrize("kind", SPECIAL)
@pytest.mark.parametrize("command", NAMED)
def test_no_output_replaces_a_device_or_a_pipe(
    command: str, kind: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = shlex.split(NAMED[command].format(robot=ROBOT, recording=RECORDING))
    inside = {"identify": "identification.json", "check": "check.json"}
    for word in [word for word in words if re.fullmatch(r"[a-c](\.\w+)?", word)]:
        path = folder / word / inside.get(command, "")
        path.parent.mkdir(exist_ok=True)
        make_special(kind, path)
        before, mode = names(folder), path.lstat().st_mode
        assert run(words) == 2
        output = capsys.readouterr().err
        assert str(path.relative_to(folder)) in output and len(output.splitlines()) == 1, output
        assert path.lstat().st_mode == mode and names(folder) == before
        path.unlink()


@pytest.mark.parametrize("command", sorted(set(NAMED) - {"identify", "check"}))
def test_a_link_is_replaced_and_its_target_kept(command: str, folder: Path) -> None:
    words = shlex.split(NAMED[command].format(robot=ROBOT, recording=RECORDING))
    paths = [folder / word for word in words if re.fullmatch(r"[a-c]\.\w+", word)]
    for k, path in enumerate(paths):
        (folder / f"secret{k}").write_text("precious", encoding="utf-8")
        path.symlink_to(f"secret{k}")
    assert run(words) in (0, 3)
    assert {(folder / f"secret{k}").read_text(encoding="utf-8") for k in range(len(paths))} == {"precious"}
    assert not any(path.is_symlink() for path in paths if path.suffix != ".json")  # no load was named
