"""Logs for viewers, opened by their own libraries: Rerun, and MCAP as ROS 2 tools read it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from diagnosis_file import write_diagnosis
from numpy.testing import assert_allclose
from servo_loops import SWING, driven

import signid
from signid.cli import run
from signid.output.viewers import ViewerLog, viewer_log
from signid.types import Recording

LAWS = ("coulomb_friction@2:level=0.8", "payload:mass=0.3,first_moment_x=0.03")
TOPICS = {"/measured", "/predicted", "/extended", "/residual", "/residual_extended"}
ROBOT = {"/robot_description", "/tf", "/tf_static"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of an arm with friction and a payload, and its diagnosis."""
    place = tmp_path_factory.mktemp("viewers")
    laws = [word for law in LAWS for word in ("--inject", law)]
    assert run(["simulate", "3r", *laws, *"--seed 3 --duration 4 -o".split(), str(place / "arm.csv")]) == 0
    write_diagnosis(place, "3r", LAWS)
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return signid.read_recording(folder / "arm.csv", signid.load_robot("3r"))


@pytest.fixture(scope="module")
def log(folder: Path, recording: Recording) -> ViewerLog:
    return viewer_log("3r", recording, folder / "diagnosis.json")


def opened(data: bytes) -> dict[str, list[tuple[int, Any]]]:
    """Stamps [ns] and messages of an MCAP file by topic, as its library and the decoder of ROS 2 read them."""
    import io

    reading = pytest.importorskip("mcap.reader", reason="mcap is not installed (extra viewers)")
    from rosbags.typesys import Stores, get_typestore

    store, found = get_typestore(Stores.ROS2_HUMBLE), dict[str, list[tuple[int, Any]]]()
    for schema, channel, message in reading.make_reader(io.BytesIO(data), validate_crcs=True).iter_messages():
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        decoded = store.deserialize_cdr(message.data, schema.name)
        found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def frame_errors(found: dict[str, list[tuple[int, Any]]], states: str) -> list[float]:
    """Largest difference of the poses by /tf and /tf_static from those of Pinocchio with /robot_description."""
    [(_, text)] = found["/robot_description"]
    robot = pin.buildModelFromXML(text.data)
    data, still = robot.createData(), [x for _, message in found.get("/tf_static", ()) for x in message.transforms]
    errors, known = [], dict(found[states])
    for stamp, message in found["/tf"]:
        above = {}
        for each in (*still, *message.transforms):
            place, turn = each.transform.translation, each.transform.rotation
            pose = pin.SE3(pin.Quaternion(turn.w, turn.x, turn.y, turn.z), np.array([place.x, place.y, place.z]))
            above[each.child_frame_id] = (each.header.frame_id, pose)
        state = dict(zip(known[stamp].name, known[stamp].position, strict=True))
        q = np.array([state[name] for name in list(robot.names)[1:]])
        pin.framesForwardKinematics(robot, data, q)
        for frame, pose in zip(robot.frames, data.oMf, strict=True):
            name, chain = frame.name, pin.SE3.Identity()
            while frame.type == pin.FrameType.BODY and name in above:
                name, step = above[name]
                chain = step * chain
            if frame.type == pin.FrameType.BODY:
                errors.append(float(np.abs(chain.homogeneous - pose.homogeneous).max()))
    return errors


def test_torque_is_measured_predicted_and_extended(log: ViewerLog, folder: Path, recording: Recording) -> None:
    signals = {signal.topic.removeprefix("/"): signal for signal in log.signals}
    assert {f"/{name}" for name in signals} == TOPICS
    measured, samples = signals["measured"], recording.read()
    rows = np.searchsorted(samples.t, measured.t - 1e-9)
    assert measured.effort is not None and measured.position is not None
    assert_allclose(measured.effort, samples.tau[rows])
    assert_allclose(measured.position, samples.q[rows], atol=1e-3)
    for name in ("predicted", "extended"):
        rest = signals["residual" if name == "predicted" else "residual_extended"]
        assert_allclose(rest.effort, measured.effort - signals[name].effort)
    before, after = (
        float(np.sqrt(np.mean(np.square(signals[name].effort)))) for name in ("residual", "residual_extended")
    )
    assert after < 0.2 * before, "the extended simulation has the laws; instants of reversal remain"
    assert any("Coulomb friction of joint_2" in remark.sentence and remark.warning for remark in log.remarks)


def test_mcap_is_opened_by_its_library_and_by_ros(log: ViewerLog, folder: Path) -> None:
    data = log.mcap() if pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)") else b""
    found = opened(data)
    assert set(found) == {*TOPICS, *ROBOT, "/findings"}
    for signal in log.signals:
        messages = found[signal.topic]
        assert_allclose([stamp * 1e-9 for stamp, _ in messages], signal.t, atol=1e-9)
        assert_allclose([message.effort for _, message in messages], signal.effort)
        assert all(tuple(message.name) == signal.joints for _, message in messages)
        assert all(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == t for t, message in messages)
    findings = [(message.msg, message.level) for _, message in found["/findings"]]
    assert findings == [(one.sentence, 30 if one.warning else 20) for one in log.remarks] and len(findings) >= 3
    assert findings[0][0].startswith("The simulation lacks") and findings[0][1] == 30
    assert_allclose(frame_errors(found, "/measured"), 0.0, atol=1e-12)
    (folder / "log.mcap").write_bytes(data)
    assert run("convert log.mcap --topic /measured -o back.csv".split()) == 0
    back = signid.read_recording(folder / "back.csv", signid.load_robot("3r")).read()
    assert_allclose(back.tau, log.signals[0].effort)


def test_mcap_repeats_its_bytes(log: ViewerLog, folder: Path, recording: Recording) -> None:
    pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")
    assert viewer_log("3r", recording, folder / "diagnosis.json").mcap() == log.mcap()


def test_rerun_opens_its_log(log: ViewerLog, tmp_path: Path) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed (extra viewers)")
    (tmp_path / "log.rrd").write_bytes(log.rrd())
    reader = chunks.RrdReader(tmp_path / "log.rrd")
    [entry] = reader.recordings()
    assert entry.application_id == "signid" and reader.blueprints(), "a layout is stored, too"
    values, texts = dict[str, list[list[float]]](), list[str]()
    for chunk in reader.stream():
        batch, path = chunk.to_record_batch(), str(chunk.entity_path)
        for name in batch.schema.names:
            if name.endswith("Scalars:scalars"):
                values.setdefault(path, []).extend(batch.column(name).to_pylist())
            if name.endswith("TextLog:text"):
                texts += [x[0] for x in batch.column(name).to_pylist()]
    for signal in log.signals:
        assert signal.effort is not None
        assert_allclose(values[f"{signal.topic}/effort"], signal.effort)
    assert sorted(texts) == sorted(f"[signid] {remark.sentence}" for remark in log.remarks)
    text = str(reader.store().schema())
    assert "/3r/visual_geometries/link_3" in text and "/tf_static" in text


def test_rerun_has_the_meshes_that_are_found(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed (extra viewers)")
    shape = '<visual><geometry><mesh filename="package://arm/{}.stl"/></geometry></visual></link>'
    text = signid.load_robot("3r").document.replace("</link>", shape.format("base"), 1)
    (tmp_path / "arm.urdf").write_text(text.replace("</link>", shape.format("absent"), 2))
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "base.stl").write_bytes(bytes(80) + (1).to_bytes(4, "little") + bytes(50))
    assert run(["replay", str(tmp_path / "arm.urdf"), "arm.csv", "--rrd", str(tmp_path / "a.rrd")]) == 0
    meshes = chunks.RrdReader(tmp_path / "a.rrd").stream()
    kept = [str(each.entity_path) for each in meshes if "Asset3D:blob" in str(each.to_record_batch().schema.names)]
    assert len(kept) == 1 and "WARN" not in capfd.readouterr().err


@pytest.mark.slow
def test_commands_write_logs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra viewers)")
    command = ["replay", "3r", "arm.csv", "--diagnosis", "diagnosis.json", "--rrd", "a.rrd", "--mcap", "a.mcap"]
    assert run(command) == 0
    out = capsys.readouterr().out
    assert "a.rrd" in out and "a.mcap" in out and "http" not in out, "no viewer opens"
    found = opened((folder / "a.mcap").read_bytes())
    assert set(found) == {*TOPICS, *ROBOT, "/findings", "/simulated", "/simulated_extended"}
    assert len(found["/simulated"]) < len(found["/measured"]), "frames of the replay"
    assert run(["diagnose", "3r", "arm.csv", "-o", "made", "--mcap", "b.mcap", "--rrd", "b.rrd"]) in (0, 3)
    assert set(opened((folder / "b.mcap").read_bytes())) == {*TOPICS, *ROBOT, "/findings"}
    assert (folder / "b.rrd").stat().st_size > 1000


def test_several_recordings_have_folders_of_topics(recording: Recording) -> None:
    pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")
    two = viewer_log("3r", [recording, recording])
    assert set(opened(two.mcap())) == {
        f"/arm_{k}/{name}" for k in (1, 2) for name in ("measured", "predicted", "residual")
    }


def test_early_and_dated_stamps(folder: Path) -> None:
    pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")
    samples = signid.read_recording(folder / "arm.csv", signid.load_robot("3r")).read()
    for first in (-1.5, 1.7e9):
        columns = {"t": samples.t + first}
        for j in range(3):
            columns |= {f"q_{j + 1}": samples.q[:, j], f"tau_{j + 1}": samples.tau[:, j]}
        made = viewer_log("3r", columns)
        stamps = [stamp for stamp, _ in opened(made.mcap())["/measured"]]
        assert stamps[0] == 0 if first < 0 else abs(stamps[0] * 1e-9 - made.signals[0].t[0]) < 1e-6
        assert_allclose(np.diff(stamps), np.median(np.diff(stamps)), atol=600)
        assert made.head.dated == (first > 0)


def test_drives_are_logged_by_their_positions(tmp_path: Path) -> None:
    pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")
    saved = driven("3r", {"joint_2": SWING.with_(kp=300.0, kd=20.0)}).save(tmp_path / "model.json")
    assert run(["simulate", str(saved), "--servo", "--duration", "3", "-o", str(tmp_path / "x.csv")]) == 0
    found = opened(viewer_log(str(saved), str(tmp_path / "x.csv")).mcap())
    assert set(found) == {*ROBOT, "/findings", "/commanded", "/measured", "/predicted", "/residual"}
    assert found["/findings"][0][1].msg.startswith("note: ")
    measured, predicted, rest = (
        np.array([message.position for _, message in found[f"/{name}"]])
        for name in ("measured", "predicted", "residual")
    )
    assert_allclose(rest[:, 1], (measured - predicted)[:, 1], atol=1e-12)
    assert len(found["/measured"][0][1].effort) == 0


@pytest.mark.parametrize(
    ("options", "lacking", "words"),
    [
        (["--rrd", "a.rrd"], "rerun", "rerun-sdk, which is not installed"),
        (["--mcap", "a.mcap"], "mcap", "pip install 'signid[viewers]'"),
        (["--mcap", "a.bag"], "", "ends in .mcap"),
        (["--rrd", "arm.csv/a.rrd"], "", "arm.csv is a file"),
    ],
)
@pytest.mark.parametrize("verb", ["replay", "diagnose"])
def test_bad_logs_end_with_a_sentence(
    verb: str,
    options: list[str],
    lacking: str,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if lacking:
        monkeypatch.setitem(sys.modules, lacking, None)
        monkeypatch.setattr("signid.output.viewers.files.find_spec", lambda name: None if name == lacking else object)
    elif "arm.csv/a.rrd" in options:
        pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra viewers)")
    more = ["-o", "never"] if verb == "diagnose" else []
    assert run([verb, "3r", "arm.csv", *more, *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not Path("never").exists()
