"""Logs of a watch: read back by independent libraries, complete after Ctrl-C; topics by a stub of rclpy."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_output_viewers import ROBOT, frame_errors, opened

import signid
from signid.cli import run
from signid.output.viewers.links import Links, drawn_urdf
from signid.regression.motion import Motion
from signid.robot import configuration
from signid.robot.dynamics import tip_jacobian
from signid.simulation.excite.families import rest_to_rest_motion

pytest.importorskip("mcap", reason="mcap is not installed (extra viewers)")

SIGNALS = {"/signid/predicted_torque", "/signid/external_torque", "/signid/threshold"}
FOUND = {"/signid/events", "/signid/log", "/signid/contacts"}
PUSH, FORCE = (7.0, 7.6), np.array([0.0, 12.0, 9.0])  # [s] and [N] at the centre of mass of the last link


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model with viscous friction, and a stream with a contact."""
    place, stated = tmp_path_factory.mktemp("watched"), signid.load_model("3r")
    model = stated.with_laws(*(f"viscous_friction@{j}:coefficient=0.4" for j in (1, 2, 3)))
    model.save(place / "model.json")
    asked = rest_to_rest_motion(model.robot, 9.0, 0.002, 4)
    tau = model.inverse(Motion(model.robot, asked.t, asked.q, asked.v, asked.a))
    tau += 0.02 * np.random.default_rng(1).standard_normal(tau.shape)
    during = (asked.t > PUSH[0]) & (asked.t < PUSH[1])
    jacobian = tip_jacobian(model.robot, configuration(model.robot, asked.q[during]))
    tau[during] -= np.einsum("tij,i->tj", jacobian, FORCE)
    names = ["t", *(f"{signal}_{j}" for signal in ("q", "tau") for j in (1, 2, 3))]
    table = np.column_stack([asked.t, asked.q, tau])
    np.savetxt(place / "stream.csv", table, delimiter=",", header=",".join(names), comments="", fmt="%.8g")
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def watched(*options: str, stream: str = "stream.csv") -> int:
    return run(["watch", "model.json", stream, "--quiet", "2", "--json", *options])


@pytest.mark.parametrize("kind", ["mcap", "rrd"])
def test_a_disk_that_fills_leaves_no_log(kind: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mcap" if kind == "mcap" else "rerun")
    resource, before = pytest.importorskip("resource"), set(folder.iterdir())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, limits[1]))
    try:
        assert watched(f"--{kind}", f"full.{kind}") == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    output = capsys.readouterr().err
    assert f"full.{kind}: File too large" in output and len(output.splitlines()) == 1, output
    assert set(folder.iterdir()) == before


def test_mcap_holds_torque_events_and_the_moving_robot(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert watched("--mcap", "a.mcap") == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    found = opened((folder / "a.mcap").read_bytes())
    assert set(found) == {"/joint_states", *SIGNALS, *FOUND, *ROBOT}
    assert [json.loads(message.data) for _, message in found["/signid/events"]] == events
    assert_allclose(frame_errors(found, "/joint_states"), 0.0, atol=1e-12)
    times = np.array([stamp * 1e-9 for stamp, _ in found["/joint_states"]])
    assert 0.95 * 100 < (len(times) - 1) / (times[-1] - times[0]) <= 101
    effort = {name: np.array([x.effort for _, x in found[name]]) for name in (*SIGNALS, "/joint_states")}
    during = (times > PUSH[0] + 0.1) & (times < PUSH[1])
    external, threshold = effort["/signid/external_torque"], effort["/signid/threshold"]
    assert (np.abs(external[during]) > threshold[during]).any(axis=1).all(), "the push exceeds a threshold"
    assert np.isnan(threshold[0]).all(), "not known in the quiet stretch"
    rest = effort["/joint_states"] - effort["/signid/predicted_torque"]
    assert np.corrcoef(rest[during, 1], external[during, 1])[0, 1] > 0.8
    begun, ended = (message.markers[0] for _, message in found["/signid/contacts"][:2])
    tail, tip = (np.array([p.x, p.y, p.z]) for p in ended.points)
    direction = (tip - tail) / np.linalg.norm(tip - tail)
    assert direction @ FORCE > 0.95 * np.linalg.norm(FORCE), "of the largest moment, known at the end"
    assert (begun.action, begun.lifetime.sec, ended.action, ended.lifetime.sec) == (0, 0, 0, 1)
    assert {message.level for _, message in found["/signid/log"]} == {20, 30}
    channels = pytest.importorskip("rosbags.rosbag2").Reader(folder / "a.mcap")
    with channels as bag:
        latched = {c.topic for c in bag.connections if any(q.durability.value == 1 for q in c.ext.offered_qos_profiles)}
    assert latched == {"/robot_description", "/tf_static"}


def test_rerun_holds_curves_events_and_links(folder: Path) -> None:
    chunks = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed (extra viewers)")
    assert watched("--rrd", "a.rrd") == 0
    reader, rows = chunks.RrdReader(folder / "a.rrd"), dict[str, int]()
    for chunk in reader.stream():
        rows[str(chunk.entity_path)] = rows.get(str(chunk.entity_path), 0) + chunk.to_record_batch().num_rows
    assert rows["/links/link_3"] == rows["/torque/joint_2/residual"] == rows["/q/joint_1/q"] > 800
    assert rows["/events"] >= 3 and rows["/contact"] >= 3 and reader.blueprints()


@pytest.mark.parametrize("source", ["panda", "mjcf"])
def test_links_of_other_robots_are_one_tree(source: str, tmp_path: Path) -> None:
    import pinocchio as pin

    if source == "mjcf":
        (tmp_path / "arm.xml").write_text(
            "<mujoco><worldbody><body name='base' pos='0 0 .1'><geom size='.1' mass='1'/>"
            "<body name='upper' pos='0 0 .2'><joint name='a' axis='0 1 0'/><geom size='.1' mass='1'/>"
            "<body name='lower' pos='.3 0 0'><joint name='b' axis='0 1 0'/><geom size='.1' mass='1'/>"
            "</body></body></body></worldbody></mujoco>"
        )
    robot = signid.load_robot(tmp_path / "arm.xml" if source == "mjcf" else source)
    links, q = Links(robot), np.linspace(0.1, 0.4, len(robot.joints))
    above = {pose.child: pose for pose in (*links.fixed, *links.poses(q))}
    bodies = [k for k, frame in enumerate(robot.model.frames) if frame.type == pin.FrameType.BODY]
    for k in bodies:
        name, chain = robot.model.frames[k].name, pin.SE3.Identity()
        while name != links.root:
            pose = above[name]
            name, chain = (
                pose.parent,
                pin.SE3(pin.Quaternion(np.array(pose.rotation)), np.array(pose.translation)) * chain,
            )
        assert chain.isApprox(links.data.oMf[k], 1e-9)
    drawn = pin.buildModelFromXML(drawn_urdf(links), pin.JointModelFreeFlyer())
    assert {frame.name for frame in drawn.frames if frame.type == pin.FrameType.BODY} >= set(robot.links)


class Shutdown(Exception):
    """As rclpy raises when a context is shut down twice."""


class Ros(ModuleType):
    """Stub of rclpy: contexts, nodes and messages that check their fields as those of ROS 2 do."""

    def __init__(self, rows: np.ndarray, interrupt: bool) -> None:
        super().__init__("rclpy")
        from rosbags.typesys import Stores, get_typestore

        self.fields = get_typestore(Stores.ROS2_HUMBLE).fielddefs
        self.classes: dict[str, type] = {}
        self.rows, self.interrupt, self.published = iter(rows), interrupt, list[tuple[str, Any]]()
        self.contexts: list[Any] = []
        self.callback: Callable[[Any], None] | None = None
        self.default = self.context_of()

    def context_of(self) -> Any:
        context = SimpleNamespace(valid=False)
        context.ok = lambda: context.valid
        context.shutdown = lambda: self.shutdown(context=context)
        self.contexts.append(context)
        return context

    def init(self, *, context: Any = None) -> None:
        (context or self.default).valid = True

    def ok(self, *, context: Any = None) -> bool:
        return bool((context or self.default).valid)

    def shutdown(self, *, context: Any = None) -> None:
        if not self.ok(context=context):
            raise Shutdown("failed to shutdown: rcl_shutdown already called on the given context")
        (context or self.default).valid = False

    def create_node(self, name: str, *, context: Any = None) -> Any:
        def create_publisher(kind: type, topic: str, qos_profile: int) -> Any:
            def publish(message: Any) -> None:
                assert type(message) is kind and self.ok(context=context)
                self.published.append((topic, message))

            return SimpleNamespace(publish=publish)

        def create_subscription(kind: type, topic: str, callback: Callable[[Any], None], qos_profile: int) -> None:
            self.callback = callback

        assert self.ok(context=context)
        made = {"create_publisher": create_publisher, "create_subscription": create_subscription}
        return SimpleNamespace(**made, destroy_node=lambda: None)

    def spin_once(self, node: Any, *, timeout_sec: float) -> None:
        assert self.callback is not None
        time.sleep(timeout_sec)
        for row in islice(self.rows, 250):
            whole, part = divmod(round(float(row[0]) * 1e9), 10**9)
            stamp = self.message("builtin_interfaces/msg/Time")(sec=whole, nanosec=part)
            header = self.message("std_msgs/msg/Header")(stamp=stamp)
            signals = {"name": ["joint_1", "joint_2", "joint_3"], "position": row[1:4].tolist(), "velocity": []}
            state = self.message("sensor_msgs/msg/JointState")
            self.callback(state(header=header, **signals, effort=row[4:7].tolist()))
            if self.interrupt and row[0] > 8.8:
                for context in self.contexts:
                    context.valid = False
                raise KeyboardInterrupt

    def message(self, kind: str) -> type:
        """Class of a kind of message."""
        if kind not in self.classes:
            fields = dict(self.fields[kind][1])

            def begin(own: Any, **given: Any) -> None:
                for name, value in given.items():
                    self.check(fields[name], value)
                    setattr(own, name, value)

            self.classes[kind] = type(kind, (), {"__init__": begin})
        return self.classes[kind]

    def check(self, form: Any, value: Any) -> None:
        node, inner = form
        if node.name == "NAME":
            assert type(value) is self.message(inner)
        elif node.name == "BASE":
            python = {"s": str, "f": float, "b": bool}.get(inner[0][0], int)
            assert type(value) is python, (inner, value)
        else:
            assert isinstance(value, list)
            for each in value:
                self.check(inner[0], each)


@pytest.fixture
def ros(folder: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Ros]:
    made = Ros(np.loadtxt(folder / "stream.csv", delimiter=",", skiprows=1), request.param)
    monkeypatch.setitem(sys.modules, "rclpy", made)
    context = ModuleType("rclpy.context")
    context.Context = made.context_of  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rclpy.context", context)
    for kind in made.fields:
        package, _, name = kind.split("/")
        if package.endswith(("_msgs", "_interfaces")):
            for module in (package, f"{package}.msg"):
                if module not in sys.modules:
                    monkeypatch.setitem(sys.modules, module, ModuleType(module))
            monkeypatch.setattr(sys.modules[f"{package}.msg"], name, made.message(kind), raising=False)
    yield made


@pytest.mark.parametrize("ros", [False, True], ids=["ends", "Ctrl-C"], indirect=True)
def test_topics_are_published_and_logs_are_complete(
    ros: Ros, folder: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    assert watched("--publish", "--idle", "0.5", "--mcap", "b.mcap", stream="ros:/joint_states") == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert {topic for topic, _ in ros.published} == {*SIGNALS, *FOUND}, "the robot publishes the others itself"
    events = [message.data for topic, message in ros.published if topic == "/signid/events"]
    assert [json.loads(text) for text in events] == [json.loads(line) for line in captured.out.splitlines()]
    assert not any(context.valid for context in ros.contexts)
    found = opened((folder / "b.mcap").read_bytes())
    assert len(found["/signid/events"]) == len(events) >= 2
    assert len(found["/tf"]) == len([topic for topic, _ in ros.published if topic == "/signid/threshold"]) > 600


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--publish"], "--publish needs rclpy of ROS 2, which is not installed here"),
        (["--mcap", "a.csv"], "ends in .mcap"),
        (["--mcap", "stream.mcap"], "is read by this command"),
    ],
)
def test_bad_logs_end_with_a_sentence(
    options: list[str], words: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    (folder / "stream.mcap").write_bytes(b"")
    assert watched(*options, stream="stream.mcap" if "stream.mcap" in options else "stream.csv") == 2
    error = capsys.readouterr().err
    assert words in " ".join(error.split()) and "Traceback" not in error
