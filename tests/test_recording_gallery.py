"""`signid data`: from the files of a public repository to the recordings that the examples read, all or nothing."""

from __future__ import annotations

import errno
import gzip
import io
import json
import os
import re
import shutil
import socket
from pathlib import Path

import pytest
from public import layout
from serving import TEXT, register, serve, toy

import signid
from signid.cli import run
from signid.errors import RecordingError
from signid.recording.gallery import DATA, data_folder, is_complete, recordings

ROOT = Path(__file__).parents[1]
PATH = "logs/a_toy.csv"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every test in a folder of its own, without SIGNID_DATA, and with a data set that it can spoil."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SIGNID_DATA", raising=False)
    monkeypatch.setenv("COLUMNS", "120")
    register(toy(), monkeypatch)
    return tmp_path


class Terminal(io.StringIO):
    """A person who types."""

    def isatty(self) -> bool:
        return True


def opened(path: Path) -> bytes:
    return gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()


@pytest.mark.slow_cases("ur10e|tx40|panda")
@pytest.mark.parametrize("name", DATA.names)
def test_the_whole_way_from_the_files_of_the_source(
    name: str, data: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = DATA[name]
    there = folder / "data" / wanted.folder
    with serve(layout(data, wanted)) as server:
        assert run(["data", name, "--yes", "--source", server.address]) == 0
        assert sorted(server.asked) == sorted(wanted.sources)
        out = capsys.readouterr().out
        assert wanted.commit in out and wanted.licence.split()[0] in out and f"export SIGNID_DATA={folder}/data" in out
        assert run(["data", name, "--source", server.address]) == 0 and len(server.asked) == len(wanted.sources)
    assert "is already complete" in capsys.readouterr().out
    for product in wanted.products:
        assert opened(there / product.name) == opened(data / wanted.folder / product.name), product.name
    names = {*(product.name for product in wanted.products), *(name for name, _ in wanted.carried)}
    assert {path.name for path in there.iterdir()} == {*names, f"source_{name}.txt"}
    assert wanted.commit in (there / f"source_{name}.txt").read_text()
    assert recordings(name) == Path("data") / wanted.folder
    monkeypatch.setenv("SIGNID_DATA", str(folder / "data"))
    assert recordings(name) == there and is_complete(wanted, there) and not is_complete(wanted, folder)


def test_the_carried_descriptions_belong_to_the_recordings(data: Path) -> None:
    for name in ("panda", "emps", "bam_xl330", "bam_sts3250"):
        (file, path), *_ = DATA[name].carried
        mine, theirs = (signid.load_robot(there) for there in (ROOT / "robots" / path, data / DATA[name].folder / file))
        assert mine.joints == theirs.joints
    numbers = [
        re.sub(r"<!--.*?-->", "", path.read_text())
        for path in (ROOT / "robots/panda/arm.urdf", data / "panda_gaz2019/panda.urdf")
    ]
    assert numbers[0] == numbers[1]


def test_the_recordings_here_are_those_that_would_be_downloaded(data: Path) -> None:
    assert [one.name for one in DATA if one.name != "toy" and not is_complete(one, data / one.folder)] == []


def test_examples_and_data_sets_belong_together() -> None:
    asking = {path.parent.name for path in ROOT.glob("robots/*/identify.py") if "recordings(" in path.read_text()}
    listed = {one.name for one in DATA if not one.example}
    assert asking == listed and {path.parent.name for path in ROOT.glob("robots/*/identify.py")} <= {*asking, "3r"}


def test_the_list_needs_no_network(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("nothing is asked of the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    assert run(["data"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for one in DATA:
        assert f"{one.name} {one.title} {one.seconds:.0f} {one.megabytes:g} no" in out
        assert f"{one.name}: github.com/{one.repository}, licence {one.licence}" in out
    assert run(["data", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["schema"], document["folder"], document["written"]) == ("signid.data/1", "data", [])
    for entry, one in zip(document["sets"], DATA, strict=True):
        assert (entry["commit"], entry["licence"], entry["here"]) == (one.commit, one.licence, False)
        assert [file["sha256"] for file in entry["files"]] == [product.sha256 for product in one.products]


def test_nothing_is_downloaded_without_consent(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    with serve({PATH: TEXT}) as server:
        for more in ([], ["--json"]):
            assert run(["data", "toy", "--source", server.address, *more]) == 2
            out, err = capsys.readouterr()
            assert err.count("\n") == 1 and "add --yes" in err and "licence MIT" in err
            assert ("licence" in out) is not bool(more)
        assert server.asked == [] and list(folder.iterdir()) == []


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("n\n", 2), ("\n", 2), ("", 130)])
def test_a_person_is_asked(
    answer: str, code: int, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal(answer))
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    with serve({PATH: TEXT}) as server:
        assert run(["data", "toy", "--source", server.address]) == code
        assert server.asked == ([PATH] if code == 0 else [])
    out = capsys.readouterr().out
    assert out.index("licence") < out.index("0" * 40) + 200 and "Download it?" in out
    assert sorted(path.name for path in folder.rglob("*.gz")) == (["toy.csv.gz"] if code == 0 else [])


def test_json_lists_the_written_files(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with serve({PATH: TEXT}) as server:
        assert run(["data", "toy", "--yes", "--json", "-o", "here", "--source", server.address]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["written"] == ["here/toy_there/toy.csv.gz", "here/toy_there/source_toy.txt"]
    assert document["sets"][0]["here"] and gzip.decompress((folder / document["written"][0]).read_bytes()) == TEXT
    assert "example" not in document and not (folder / "data").exists()


@pytest.mark.parametrize("spoilt", [TEXT[:-1], TEXT + b"0.2,0,0\n", b"", b"\xff"])
def test_another_text_leaves_nothing(spoilt: bytes, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with serve({PATH: spoilt}) as server:
        assert run(["data", "toy", "--yes", "--source", server.address]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "toy.csv.gz" in err and "--source URL" in err
    assert list(folder.iterdir()) == []


def test_an_interruption_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: bytes) -> str:
        raise KeyboardInterrupt

    register(toy(interrupt), monkeypatch)
    with serve({PATH: TEXT}) as server:
        assert run(["data", "toy", "--yes", "--source", server.address]) == 130
    assert list(folder.iterdir()) == []


def test_a_full_disk_leaves_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with serve({PATH: TEXT}) as server:
        with monkeypatch.context() as patch:
            patch.setattr("os.replace", full)
            assert run(["data", "toy", "--yes", "--source", server.address]) == 2
        err = capsys.readouterr().err
        assert "No space left" in err and "-o" in err and list(folder.iterdir()) == []
        (folder / "file").write_text("")
        server.asked.clear()
        assert run(["data", "toy", "--yes", "-o", "file", "--source", server.address]) == 2
        assert server.asked == [] and "is a file" in capsys.readouterr().err


def test_a_damaged_recording_is_replaced(folder: Path) -> None:
    there = folder / "data" / "toy_there"
    with serve({PATH: TEXT}) as server:
        for spoil in (b"", gzip.compress(TEXT)[:-9], gzip.compress(TEXT + b"0.2,0,0\n")):
            assert run(["data", "toy", "--yes", "--source", server.address]) == 0 and is_complete(toy(), there)
            (there / "toy.csv.gz").write_bytes(spoil)
            assert not is_complete(toy(), there)
        assert len(server.asked) == 3


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["pandaa"], "no data named 'pandaa'; did you mean panda?"),
        (["kuka"], "choose from 1r, 3r, emps, panda, tx40, ur10e, bam_xl330, bam_sts3250"),
        (["toy", "--yes", "--source", "http://example.com"], "not a valid address for downloads"),
        (["toy", "--yes", "-o", ""], "not a folder"),
        (["--yes"], "no data set was named"),
    ],
)
def test_bad_usage(given: list[str], message: str, capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    assert run(["data", *given]) == 2
    err = capsys.readouterr().err
    assert message in err and err.count("\n") == 1 and list(folder.iterdir()) == []


def test_where_recordings_are_looked_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert data_folder() == Path("data")
    with pytest.raises(RecordingError, match="SIGNID_DATA is not set, and there is no folder .*; run signid data toy"):
        recordings("toy")
    (folder / "data" / "toy_there").mkdir(parents=True)
    with pytest.raises(RecordingError, match="toy_there lacks toy.csv.gz; run signid data toy"):
        recordings("toy")
    (folder / "data" / "toy_there" / "toy.csv.gz").touch()
    assert recordings("toy") == Path("data/toy_there")
    monkeypatch.setenv("SIGNID_DATA", str(folder / "elsewhere"))
    with pytest.raises(RecordingError, match="SIGNID_DATA is .*elsewhere, and"):
        recordings("toy")
    shutil.move(folder / "data", folder / "elsewhere")
    assert recordings("toy") == folder / "elsewhere" / "toy_there"
