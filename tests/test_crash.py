"""Kills, full disk, no memory, two runs at once, strange paths: files are complete or absent."""

from __future__ import annotations

import errno
import os
import random
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from swing import csv, swing

from signid.cli import run
from signid.errors import OutputError, RecordingError
from signid.output.report import write_files
from signid.recording.formats import base, csv_, find_format

HERE = Path(__file__).parents[1]
THERE = {**os.environ, "PYTHONPATH": str(HERE), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
FILES, SIZE, KILLS, ROUNDS = 5, 400_000, 8, 30
WRITER = f"""if 1:
    import sys
    from signid.output.report.write import write_files
    folder, mark, rounds = sys.argv[1], sys.argv[2], int(sys.argv[3])
    for k in range(1, rounds + 1):
        body = f"{{mark}} {{k:09d}};"
        write_files(folder, {{f"{{i}}.txt": body * ({SIZE} // len(body)) for i in range({FILES})}}, named=True)
        print(k, flush=True)
"""


def writer(folder: Path, mark: str, rounds: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITER, str(folder), mark, str(rounds)]
    return subprocess.Popen(command, env=THERE, stdout=subprocess.PIPE, text=True)


def generation(path: Path) -> str:
    """Pattern of a complete file, from its beginning to its end."""
    text = path.read_text()
    first = text.partition(";")[0]
    assert text == f"{first};" * (SIZE // (len(first) + 1)), f"{path.name} is not whole"
    return first


def test_files_are_complete_after_a_kill_at_any_moment(tmp_path: Path) -> None:
    rng = random.Random(0)
    for kill in range(KILLS):
        folder = tmp_path / str(kill % 3)  # new at first, then with the files of killed runs
        process = writer(folder, f"{kill:03d}", 10**6)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(rng.uniform(0, 0.03))
        process.kill()
        process.communicate()
        made = [generation(folder / f"{i}.txt") for i in range(FILES)]
        assert made[0] <= min(made), "the first appears last"


def test_files_of_killed_runs_are_removed_a_day_later(tmp_path: Path) -> None:
    process = writer(tmp_path, "a", 10**6)
    assert process.stdout is not None
    process.stdout.readline()
    while not (left := list(tmp_path.glob(".signid-*"))):
        time.sleep(0.001)
    process.kill()
    process.communicate()
    left = list(tmp_path.glob(".signid-*"))
    foreign = [tmp_path / name for name in (".signid-notes", ".signid-folder12", ".signid-mine.txt", "signid-12345678")]
    foreign[1].mkdir()
    for path in foreign[:1] + foreign[2:]:
        path.write_text("not of signid")
    young, old = tmp_path / ".signid-abcd1234", tmp_path / ".signid-zyxw9876"
    for path, days in ((young, 0.9), (old, 1.1), *((path, 30.0) for path in foreign)):
        path.touch()
        os.utime(path, (time.time() - days * 86_400,) * 2)
    write_files(tmp_path, {"new.txt": "new"}, named=True)
    assert young.exists() and not old.exists() and all(path.exists() for path in [*left, *foreign])
    for path in (young, *left):
        os.utime(path, (0, 0))
    write_files(tmp_path, {"new.txt": "newer"}, named=True)
    assert not any(path.exists() for path in (young, *left)) and all(path.exists() for path in foreign)


def test_two_runs_at_once_leave_complete_files(tmp_path: Path) -> None:
    both = [writer(tmp_path / "out", mark, ROUNDS) for mark in ("a", "b")]
    for process in both:
        process.communicate(timeout=300)
        assert process.returncode == 0
    assert {generation(tmp_path / "out" / f"{i}.txt") for i in range(FILES)} <= {f"{x} {ROUNDS:09d}" for x in "ab"}
    assert len(list((tmp_path / "out").iterdir())) == FILES, "nothing else is left"


@pytest.mark.slow_cases("parquet|npz")
@pytest.mark.parametrize("name", ["out.csv", "out.parquet", "out.npz"])
def test_a_full_disk_is_reported(name: str, tmp_path: Path) -> None:
    pytest.importorskip("resource")
    program = """if 1:
        import resource, sys
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))
        from signid.cli import run
        sys.exit(run(sys.argv[1:]))
    """
    command = [sys.executable, "-c", program, "simulate", "1r", "--duration", "4", "--motion", "m.csv", "-o", name]
    (tmp_path / "m.csv").write_text(csv(swing(tau_1=None)))
    done = subprocess.run(command, cwd=tmp_path, env=THERE, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert "free disk space" in done.stderr and len(done.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]


@pytest.mark.parametrize(
    ("where", "number"),
    [
        ("os.replace", errno.ENOSPC),
        ("os.fdopen", errno.EROFS),
        ("tempfile.mkstemp", errno.EACCES),
        ("pathlib.Path.chmod", errno.EIO),
        ("pathlib.Path.mkdir", errno.EDQUOT),
    ],
)
def test_a_failed_write_leaves_nothing(
    where: str, number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as broken:
        broken.setattr(where, fail)
        with pytest.raises(OutputError, match=os.strerror(number)):
            write_files(tmp_path / "new", {"a.txt": "a", "b.txt": b"b"})
    assert not list(tmp_path.rglob("*.*"))


def test_a_failed_part_leaves_nothing(tmp_path: Path) -> None:
    def pieces() -> object:
        yield "half"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_files(tmp_path / "new", {"a.txt": "a", "b.txt": pieces()})  # type: ignore[dict-item]
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_strange_paths_work_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a folder é 日本 'x' %20 #1"
    folder.mkdir()
    monkeypatch.chdir(folder)
    Path("ä b.csv").write_text(csv(swing()))
    Path("mein Arm ö.urdf").write_bytes((HERE / "robots/1r/robot.urdf").read_bytes())
    for command in (
        "inspect 'mein Arm ö.urdf'",
        "check 'mein Arm ö.urdf' 'ä b.csv'",
        "identify 'mein Arm ö.urdf' 'ä b.csv' -o 'aus gabe'",
        "diagnose 'mein Arm ö.urdf' 'ä b.csv' -o 'diag nose'",
        "simulate 'aus gabe/model.json' --motion 'ä b.csv' --duration 1 -o 'sim ß.parquet'",
        "export 'aus gabe/model.json' --urdf 'é.urdf' --mjcf 'é.xml' --function 'f é.py'",
        "replay 'aus gabe/model.json' 'ä b.csv' --html 'é è.html'",
        "replay 'mein Arm ö.urdf' 'ä b.csv' --diagnosis 'diag nose' --html 'é 2.html'",
        "inspect 'é.xml'",
    ):
        assert run(shlex.split(command)) in (0, 3), (command, capfd.readouterr().err)
    assert Path("é è.html").is_file() and Path("é 2.html").is_file() and Path("f é.py").is_file()


def test_too_little_memory_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.csv"
    path.write_text(csv(swing()))
    monkeypatch.setattr(base, "free_memory", lambda: 1000.0)
    with pytest.raises(RecordingError, match="Parquet"):
        find_format(path).open(path)
    monkeypatch.setattr(csv_, "free_memory", lambda: 1000.0)
    packed = tmp_path / "r.csv.gz"
    packed.write_bytes(find_format(packed).encode(swing(), packed.name))
    with pytest.raises(RecordingError, match="Parquet"):
        find_format(packed).open(packed)


@pytest.mark.slow
def test_a_memory_limit_is_reported(tmp_path: Path) -> None:
    pytest.importorskip("resource")
    program = """if 1:
        import resource, sys
        from signid.cli import run
        import signid.simulation.plant, signid.recording.formats.csv_, signid.identify, signid.output.report
        used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + 400_000_000, resource.RLIM_INFINITY))
        sys.exit(run(sys.argv[1:]))
    """
    if not Path("/proc/self/statm").is_file():
        pytest.skip("needs /proc")
    for command in ("simulate 3r --duration 4900 -o out.csv", "identify 1r zeros.csv.gz -o out"):
        if "zeros" in command:
            import gzip

            (tmp_path / "zeros.csv.gz").write_bytes(gzip.compress(b"t,q_1,tau_1\n" + b"0,0,0\n" * 40_000_000, 1))
        done = subprocess.run(
            [sys.executable, "-c", program, *command.split()], cwd=tmp_path, env=THERE, capture_output=True, text=True
        )
        assert done.returncode == 2, (done.returncode, done.stderr)
        assert "memory" in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert not (tmp_path / "out").exists() and not (tmp_path / "out.csv").exists()
