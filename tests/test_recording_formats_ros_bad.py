"""Bags that are unreadable or need further options are refused in one sentence."""

from __future__ import annotations

import bz2
import os
import shutil
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import CONTROL, JOINTS, KINDS, START, control, point, state, states, store, write1, write2
from test_recording import arm
from test_recording_formats import refusal
from test_recording_formats_ros import opened

from signid.errors import OptionError, RecordingError
from signid.recording import read_recording
from signid.recording.formats import FORMATS, base, find_format

FILES = ("a.bag", "bare.db3", "bare.mcap")


def refused(path: Path, *culprits: str, topics: tuple[str, ...] = ()) -> None:
    with refusal(str(path), *culprits):
        opened(path, *topics)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bag of ROS 1, a database and an MCAP of a hundred messages each, and a bag's folder."""
    folder = tmp_path_factory.mktemp("bags")
    for kind in ("ROS 1", "a bare db3", "a bare MCAP", "ROS 2"):
        known = store(first=kind == "ROS 1")
        KINDS[kind](folder, known, states(known, n=100))
        if kind.startswith("a bare"):
            shutil.rmtree(folder / "a")
    return folder


@pytest.mark.parametrize("name", FILES)
def test_cut_short(name: str, good: Path, tmp_path: Path) -> None:
    content = (good / name).read_bytes()
    for share in (0.0, 0.001, 0.1, 0.5, 0.9, 0.999):
        (tmp_path / name).write_bytes(content[: int(share * len(content))])
        refused(tmp_path / name, "damaged")


def noise(path: Path) -> Path:
    path.write_bytes(bytes(range(256)) * 50)
    return path


def half(good: Path, folder: Path, change: Callable[[Path], object]) -> Path:
    """A bag's folder, spoilt."""
    change(Path(shutil.copytree(good / "a", folder / "bag")))
    return folder / "bag"


FOLDERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no database": (lambda bag: (bag / "a.db3").unlink(), "missing"),
    "an empty database": (lambda bag: (bag / "a.db3").write_bytes(b""), "damaged"),
    "a pipe for a database": (lambda bag: ((bag / "a.db3").unlink(), os.mkfifo(bag / "a.db3")), "not a regular file"),
    "no metadata in it": (lambda bag: (bag / "metadata.yaml").write_text("a: 1"), "metadata"),
    "metadata that is no YAML": (lambda bag: (bag / "metadata.yaml").write_text("{[:"), "YAML"),
    "metadata not UTF-8": (lambda bag: (bag / "metadata.yaml").write_bytes(b"\xff\xfe\xfa"), "damaged"),
    "a later version": (
        lambda bag: (bag / "metadata.yaml").write_text(
            (bag / "metadata.yaml").read_text().replace("version: 9", "version: 99")
        ),
        "version 99",
    ),
}


@pytest.mark.parametrize("case", FOLDERS)
def test_spoilt_folders(case: str, good: Path, tmp_path: Path) -> None:
    if "pipe" in case and not hasattr(os, "mkfifo"):
        pytest.skip("no named pipes here")
    change, culprit = FOLDERS[case]
    refused(half(good, tmp_path, change), culprit)


def test_files_that_are_no_bag(good: Path, tmp_path: Path) -> None:
    for name in FILES:
        refused(noise(tmp_path / name), "damaged")
        (tmp_path / "wrong").mkdir(exist_ok=True)
        other = FILES[FILES.index(name) - 1]
        shutil.copy(good / name, tmp_path / "wrong" / other)
        refused(tmp_path / "wrong" / other, "damaged")
    (tmp_path / "folder.bag").mkdir()
    with pytest.raises(RecordingError, match=r"folder\.bag is a folder; expected .* metadata\.yaml"):
        find_format(tmp_path / "folder.bag")
    with pytest.raises(RecordingError, match="does not exist"):
        read_recording(tmp_path / "gone.bag", arm())
    (tmp_path / "loop.mcap").symlink_to(tmp_path / "loop.mcap")
    with pytest.raises(RecordingError, match="does not exist"):
        read_recording(tmp_path / "loop.mcap", arm())


def test_links_and_foreign_letters_are_followed(good: Path, tmp_path: Path) -> None:
    for name in (*FILES, "a"):
        link = tmp_path / f"Prüfstand №1 {name}"
        link.symlink_to(good / name)
        np.testing.assert_array_equal(read_recording(link, arm()).read().q, read_recording(good / name, arm()).read().q)


def test_other_topics(tmp_path: Path) -> None:
    known = store()
    point_ = known.types["geometry_msgs/msg/Point"](1.0, 2.0, 3.0)
    path = write2(tmp_path / "a", known, [("/tip", point_, START)])
    refused(path, "JointState, JointTrajectoryControllerState or JointTrajectory", "/tip (geometry_msgs/msg/Point)")
    refused(path, "/tip holds geometry_msgs/msg/Point", topics=("/tip",))
    refused(write2(tmp_path / "b", known, []), "no topic")
    refused(write2(tmp_path / "c", known, []), "no topic /tip", "none", topics=("/tip",))


def test_no_joints(tmp_path: Path) -> None:
    known = store()
    nameless = [("/js", state(known, START + k, [], [1.0], [], []), START + k) for k in range(9)]
    refused(write2(tmp_path / "a", known, nameless), "/js holds no joints")
    empty = [("/js", state(known, START + k, JOINTS, [], [], []), START + k) for k in range(9)]
    refused(write2(tmp_path / "b", known, empty), "no position and no torque")
    twice = [("/js", state(known, START, ["a", "a"], [1.0, 2.0], [], []), START)]
    refused(write2(tmp_path / "c", known, twice), "names a joint twice")
    crowd = [("/js", state(known, START + k, [f"j{k}"], [1.0], [], []), START + k) for k in range(1001)]
    refused(write2(tmp_path / "d", known, crowd), "1000")


def test_topics_that_cannot_be_joined(tmp_path: Path) -> None:
    known = store()
    late = [(topic, message, at + 10**10) for topic, message, at in states(known, "/b", n=50)]
    bare = [("/a", state(known, 0, JOINTS, [0.1 * k] * 3, [], []), START + 10**7 * k) for k in range(50)]
    refused(write2(tmp_path / "a", known, [*bare, *late]), "2 topics")
    refused(tmp_path / "a", "do not overlap", topics=("/a", "/b"))
    refused(write2(tmp_path / "b", known, [bare[0], *states(known, "/b", n=50)]), "single", topics=("/a", "/b"))


def test_a_type_that_the_bag_does_not_describe(tmp_path: Path) -> None:
    """Old databases hold no definitions; a controller's state has had several."""
    known: Any = store()
    message = control(known, START, JOINTS, point(known, 0), point(known, 0, [1.0] * 3))
    path = write2(tmp_path / "a", known, [("/state", message, START)])
    with sqlite3.connect(path / "a.db3") as database:
        database.execute("DELETE FROM message_definitions")
    refused(path, CONTROL, "MCAP")


def test_several_topics_are_listed(tmp_path: Path) -> None:
    known = store()
    path = write2(tmp_path / "a", known, [*states(known, "/left/joint_states"), *states(known, "/right/joint_states")])
    words = ("2 topics", "/left/joint_states", "400 messages", "100 Hz", "shoulder", "/right/joint_states", "--topic")
    refused(path, *words)
    refused(path, "perhaps /left/joint_states is meant", topics=("/left/joint_state",))
    assert opened(path, "/left/joint_states")[0].rows == 400
    with pytest.raises(OptionError, match="no topics"):
        read_recording({"t": [1, 2]}, arm(), topics=("/a",))
    with pytest.raises(OptionError, match="cannot be written"):
        FORMATS["rosbag"].encode({}, "a.bag")


def test_a_bag_of_ros_1_without_its_index(tmp_path: Path) -> None:
    known = store(first=True)
    path = write1(tmp_path / "a.bag", known, states(known, n=20))
    content = path.read_bytes()
    at = content.index(b"index_pos=") + len("index_pos=")
    path.write_bytes(content[:at] + bytes(8) + content[at + 8 :])
    refused(path, "reindex")


@pytest.mark.slow
def test_a_bag_that_unpacks_to_more_than_memory_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten megabytes of zeros in every fifty bytes of a chunk; data after them are not read."""
    resource = pytest.importorskip("resource")
    if not Path("/proc/self/statm").is_file():
        pytest.skip("needs /proc")
    limits = resource.getrlimit(resource.RLIMIT_AS)
    known = store(first=True)
    path = write1(tmp_path / "a.bag", known, states(known, n=100), squeeze="BZ2")
    content, bomb = path.read_bytes(), bz2.compress(bytes(10**7)) * 60
    at = content.index(b"BZh")
    path.write_bytes(content[:at] + bomb + content[at + len(bomb) :])
    refused(path, "damaged")
    monkeypatch.setattr(base, "free_memory", lambda: 1e8)
    refused(path, "more memory than there is")
    assert resource.getrlimit(resource.RLIMIT_AS) == limits


def test_without_the_library_a_sentence_gives_the_install_command(good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.setitem(sys.modules, name, None)
    refused(good / "a.bag", "pip install 'signid[ros]'")
