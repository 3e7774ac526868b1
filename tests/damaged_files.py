"""File readers as functions of bytes, with seed files; a reader refuses a file with a SignidError."""

from __future__ import annotations

import gzip
import io
import json
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from bags import CONTROL, DYNAMIC, STATE, Message, control, dynamic, point, state, store, write1, write2
from scipy.io import savemat

import signid
from signid.cli.fleet.manifest import read_manifest
from signid.errors import SignidError
from signid.estimation.pbrp import Bounds, read_bounds
from signid.output.replay.marks import read_found
from signid.recording import read_recording
from signid.recording.formats import find_format
from signid.recording.mapping import ColumnMap
from signid.recording.sampling import survey
from signid.robot import sandbox
from signid.robot.load import state_actuators
from signid.simulation.plant import read_motion
from signid.types import Robot

JOINT, ROWS, STEP, FPS = "joint_1", 40, 20_000_000, 50  # STEP [ns]
TABLE, DESCRIPTION = "data/chunk-000/file-000.parquet", "meta/info.json"


@cache
def pendulum() -> Robot:
    """The robot 1r."""
    return signid.load_robot("1r")


def bag1(kind: str, squeeze: str = "") -> bytes:
    """ROS 1 bag with messages of one type; `squeeze` names the chunk compression."""
    with tempfile.TemporaryDirectory() as folder:
        known = store(first=True)
        return write1(Path(folder) / "r.bag", known, _messages(known, kind), squeeze).read_bytes()


def bag2(kind: str, mcap: bool = False, squeeze: str = "") -> Mapping[str, bytes]:
    """Files by name of a ROS 2 bag with messages of one type."""
    with tempfile.TemporaryDirectory() as folder:
        known = store()
        path = write2(Path(folder) / "r", known, _messages(known, kind), mcap, squeeze)
        return {part.name: part.read_bytes() for part in path.iterdir()}


def _messages(known: Any, kind: str) -> Iterator[Message]:
    for k in range(ROWS):
        at, q = k * STEP, float(np.sin(k / 5))
        if kind == STATE:
            message = state(known, at, [JOINT], [q], [], [2 * q])
        elif kind == DYNAMIC:
            message = dynamic(known, at, {JOINT: {"position": q, "effort": 2 * q, "current": k}})
        else:
            message = control(known, at, [JOINT], point(known, 0, [q]), point(known, 0, [q], [], [], [2 * q]))
        yield "/joints", message, at


def dataset() -> Mapping[str, bytes]:
    """Files by name of a LeRobot dataset with two episodes."""
    number = np.arange(2 * ROWS) % ROWS
    values = {"observation.state": np.sin(number / 5), "observation.effort": np.cos(number / 5), "action": number / 9}
    columns = {name: pl.Series(value[:, None], dtype=pl.Array(pl.Float32, 1)) for name, value in values.items()}
    index = {"timestamp": (number / FPS).astype(np.float32), "frame_index": number}
    frame = pl.DataFrame({**columns, **index, "episode_index": np.repeat([0, 1], ROWS)})
    features = {name: {"dtype": "float32", "shape": [1], "names": [f"{JOINT}.pos"]} for name in values}
    features["observation.effort"]["names"] = {"motors": [JOINT]}
    table = io.BytesIO()
    frame.write_parquet(table)
    info = {"codebase_version": "v3.0", "fps": FPS, "features": features}
    return {TABLE: table.getvalue(), DESCRIPTION: json.dumps(info).encode()}


HERE = Path(__file__).parents[1]
ARROW = ("uncompressed", "lz4", "zstd")
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
XACRO = f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="m" default="2"/>
<xacro:property name="size" value="${{1 + 2 * 3}}"/><xacro:include filename="other.xacro"/>
<xacro:macro name="pair" params="name parent"><link name="${{name}}">{INERTIAL}</link><joint name="j_${{name}}"
type="revolute"><parent link="${{parent}}"/><child link="${{name}}"/><axis xyz="0 0 1"/></joint></xacro:macro>
<link name="a"/><xacro:if value="${{size > 3}}"><xacro:pair name="b" parent="a"/></xacro:if></robot>"""
MJCF = """<mujoco model="m"><compiler angle="radian"/><option gravity="0 0 -9.81"/><default><default class="c"><joint
damping="1" armature="0.1" frictionloss="0.2" range="-1 1"/></default></default><worldbody><body name="a" pos="0 0 1">
<inertial pos="0 0 0.1" mass="2" diaginertia="0.1 0.1 0.1"/><joint name="j" axis="0 1 0" class="c"/><body name="b">
<joint name="k" type="slide"/><geom type="sphere" size="0.1" mass="1"/></body></body></worldbody><include file="o.xml"/>
<equality><joint joint1="j" joint2="k" polycoef="0 1 0 0 0"/></equality></mujoco>"""
ACTUATORS = """["joint"."1"]\narmature = 0.1\nviscous_friction = 1e-3\ncoulomb_friction = 2
torque_offset = 0x1F\ntorque_constant = 1_000\n"""
COLUMNS = 't = "time"\nq_1 = "pos"\ntau_joint_1 = """eff"""\n'
BOUNDS = "[link.link_1]\nmass = [0.1, 2]\nfirst_moment = [[0, 1], [0, 1], [0, 1.5]]\n[link.link_2]\nmass = [1, 2]\n"
MANIFEST = b"""robot,recording,held_out,name,time,task
3r,a.csv;b.csv,c.csv,"arm, 7",2026-03-31T12:00+02:00,identify\n1r,a.csv,,,,\n"""
TOKENS = (  # inserted by mutations
    b"nan", b"inf", b"-1e999", b"1e300", b"-0", b"0x7fffffffffffffff", b"9" * 5000, b"[" * 5000, b"{" * 3000, b"\0",
    b"\r", b"\xff\xfe", b'"', b"<a>" * 300, b"<!DOCTYPE r [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>", b"&a;", b"--",
    b"${9**9**9}", b"$(find nothing)", b"$(env HOME)", b"../../../../../../etc/passwd", b",,,,", b";", b"\t", b"#",
    b"t,t", b"<!--", b"q_1", b"tau_1", b"abs_tau_1", b"null", b"true", b"{}", b"[]", b'"x"', b"-1",
    b"1.5e-310", b"joint_1", b"mimic", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0", b"MSG: a/b\n",
    "ä".encode(), b"\x1f\x8b", b"PK\3\4", b"PAR1", b"\xe2\x80\xa8", b"1,5", b"3" * 200_000,
)  # fmt: skip


@dataclass(frozen=True)
class Reader:
    """File name, seed contents and read function."""

    name: str
    file: str
    seeds: Sequence[bytes]
    read: Callable[[Path], object]
    wrap: Callable[[bytes], bytes] = bytes  # encloses mutated content, so that no checksum rejects it
    beside: Mapping[str, bytes] = field(default_factory=dict)  # intact files read with it
    slow: bool = False  # starts a process for each file

    def __call__(self, content: bytes, folder: Path) -> bool:
        """Whether the file is accepted; exceptions other than SignidError pass through."""
        for name, held in {**self.beside, self.file: self.wrap(content)}.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(held)
        try:
            self.read(folder / self.file)
        except SignidError as error:
            assert str(error).strip() and "\n" not in str(error), "error without one sentence"
            return False
        return True


@cache
def readers() -> tuple[Reader, ...]:
    """All readers."""
    table = b"t,q_1,tau_1,dq_1\n" + b"".join(b"%g,%g,%g,1\n" % (0.1 * k, np.sin(0.1 * k), k) for k in range(60))
    semicolon = table.replace(b",", b";").replace(b".", b",")
    urdf = (HERE / "robots/3r/robot.urdf").read_bytes()
    model, diagnosis = _saved()
    bag, plain, chunked = bag2(STATE), bag2(STATE, mcap=True), bag2(STATE, mcap=True, squeeze="STORAGE")
    joints = dataset()
    return (
        Reader("URDF", "r.urdf", [urdf, _small_urdf().encode()], signid.load_robot),
        Reader("xacro", "r.xacro", [XACRO.encode()], _expanded, beside={"other.xacro": b"<robot/>"}, slow=True),
        Reader("MJCF", "r.xml", [MJCF.encode()], signid.load_robot, beside={"o.xml": b"<mujocoinclude/>"}),
        Reader("actuators", "a.toml", [ACTUATORS.encode()], lambda path: state_actuators(pendulum(), path)),
        Reader("columns", "c.toml", [COLUMNS.encode()], _mapped),
        Reader("bounds", "b.toml", [BOUNDS.encode()], _bounds),
        Reader("CSV", "r.csv", [table, semicolon, b"# " + table], _recorded),
        Reader(
            "CSV, gzip inside", "r.csv.gz", [table], _recorded, wrap=lambda content: gzip.compress(content, 1, mtime=0)
        ),
        Reader("CSV, gzip", "r.csv.gz", [gzip.compress(table, mtime=0)], _recorded),
        Reader("Parquet", "r.parquet", [_encoded("r.parquet"), _encoded("r.parquet", 9000)], _recorded),
        Reader("NPZ", "r.npz", [_encoded("r.npz")], _recorded),
        Reader("NPZ, arrays", "r.npz", [_array(np.arange(90) / 9), _array(np.ones((5, 2)))], _recorded, wrap=_zipped),
        *array_readers(),
        Reader(
            "ROS 1 bag",
            "r.bag",
            [bag1(STATE), bag1(CONTROL), bag1(DYNAMIC), bag1(STATE, "BZ2"), bag1(STATE, "LZ4")],
            _recorded,
        ),
        Reader("ROS 2 bag", "r.db3", [bag["r.db3"], bag2(CONTROL)["r.db3"], bag2(DYNAMIC)["r.db3"]], _recorded),
        Reader("ROS 2 bag, metadata", "metadata.yaml", [bag["metadata.yaml"]], _folder, beside={"r.db3": bag["r.db3"]}),
        Reader("MCAP", "r.mcap", [each["r.mcap"] for each in (plain, bag2(CONTROL, mcap=True), chunked)], _recorded),
        Reader("LeRobot", TABLE, [joints[TABLE]], _dataset, beside={DESCRIPTION: joints[DESCRIPTION]}),
        Reader("LeRobot, description", DESCRIPTION, [joints[DESCRIPTION]], _dataset, beside={TABLE: joints[TABLE]}),
        Reader("manifest", "m.csv", [MANIFEST], read_manifest),
        Reader(
            "motion", "m.csv", [table.replace(b"tau_1", b"ddq_1"), table], lambda path: read_motion(path, pendulum())
        ),
        Reader("model.json", "model.json", [model], signid.load_model),
        Reader("diagnosis.json", "diagnosis.json", [diagnosis], read_found, beside={"model.json": model}),
    )


def array_readers() -> Iterator[Reader]:
    """Readers of JSON, Arrow, single arrays, MATLAB and, where h5py is installed, HDF5."""
    rows, columns = _json()
    yield Reader("JSON lines", "r.jsonl", [rows], _recorded)
    yield Reader("JSON", "r.json", [columns, b"[" + rows.strip().replace(b"\n", b",") + b"]", rows], _recorded)
    yield Reader("Arrow", "r.feather", [_arrow(kind, stream) for kind in ARROW for stream in (False, True)], _recorded)
    yield Reader("NPY", "r.npy", [_array(_structured()), _array(np.ones((60, 3)))], _named)
    yield Reader("MATLAB", "r.mat", [_matlab(), _matlab(do_compression=True), _matlab(format="4")], _recorded)
    if find_spec("h5py"):
        yield Reader("HDF5", "r.h5", [_hdf5()], _recorded)


def _expanded(path: Path) -> None:
    sandbox.MAX_SECONDS = 3  # limits endless programs [s]
    signid.load_robot(path)


def _recorded(path: Path, columns: ColumnMap | None = None) -> None:
    recording = read_recording(path, pendulum(), columns=columns)
    survey(recording, pendulum())
    recording.read(0, 10)


def _folder(path: Path) -> None:
    _recorded(path.parent)


def _dataset(path: Path) -> None:
    home = path.parents[2 if path.suffix == ".parquet" else 1]
    _recorded(home, {"units": {"q": "rad", "q_des": "rad", "tau": "N.m"}})


def _named(path: Path) -> None:
    """Read a structured array, or one whose columns are named here."""
    try:
        _recorded(path, {"tau_1": "tau.a"})
    except SignidError as error:
        assert str(error).strip(), "error without message"
        _recorded(path, {"names": ["t", "q_1", "tau_1"]})


def _mapped(path: Path) -> None:
    arrays = {name: np.arange(20.0) for name in ("time", "pos", "eff")}
    read_recording(arrays, pendulum(), columns=path)


def _bounds(path: Path) -> None:
    read_bounds(path, ["link_1", "link_2"], Bounds(np.zeros(20), np.ones(20)))


def _small_urdf() -> str:
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    more = '<limit lower="-1" upper="1" effort="9" velocity="2"/><dynamics damping="1" friction="2"/>'
    follows = '<joint name="k" type="prismatic"><parent link="b"/><child link="c"/><mimic joint="j" multiplier="2"/>'
    links = f'<link name="a"/><link name="b">{INERTIAL}</link><link name="c">{INERTIAL}</link>'
    return f'<?xml version="1.0"?><robot name="r">{links}{joint}{more}</joint>{follows}</joint></robot>'


@cache
def _saved() -> tuple[bytes, bytes]:
    """A model.json and its diagnosis.json."""
    law = {"effect": "spring", "joint": "joint_1", "parameters": {"stiffness": 1.0, "rest": 0.1}}
    model = {**signid.load_model("1r").document(), "effects": [law]}
    values = {key: {"value": value, "std": 0.1, "unit": "N.m"} for key, value in law["parameters"].items()}
    finding = {**law, "parameters": values, "role": "cause", "probability": 0.9}
    diagnosis = {"schema": "signid.diagnosis/1", "verdict": "named", "findings": [finding]}
    return json.dumps(model).encode(), json.dumps(diagnosis).encode()


def _encoded(name: str, rows: int = 60) -> bytes:
    t = np.arange(rows) / 100
    return find_format(Path(name)).encode({"t": t, "q_1": np.sin(t), "tau_1": np.cos(t)}, name)


def _columns() -> dict[str, np.ndarray]:
    t = np.arange(60) / 100
    return {"t": t, "q": np.sin(t)[:, None], "tau": np.cos(t)[:, None]}


def _json() -> tuple[bytes, bytes]:
    """An object for each sample in lines, and an object of lists."""
    columns = {name: value.tolist() for name, value in _columns().items()}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    lines = "".join(json.dumps({**row, "mode": "run", "imu": {"a": [0, None]}}) + "\n" for row in rows)
    return lines.encode(), json.dumps({"by": {"me": 1}, **columns}).encode()


def _arrow(kind: Any, stream: bool) -> bytes:
    file, frame = io.BytesIO(), pl.DataFrame(_columns()).with_columns(s=pl.struct(a=1, b=pl.lit("x")))
    (frame.write_ipc_stream if stream else frame.write_ipc)(file, compression=kind)
    return file.getvalue()


def _structured() -> np.ndarray:
    array = np.zeros(60, [("t", "f8"), ("q", "f8", (1,)), ("tau", [("a", "f8")])])
    for name, value in _columns().items():
        array[name] = value[:, 0] if name == "tau" else value
    return array


def _matlab(**options: Any) -> bytes:
    file, given = io.BytesIO(), {"t": _columns()["t"], "q_1": _columns()["q"], "tau_1": _columns()["tau"]}
    log = {} if "format" in options else {"log": {"a": {"b": np.ones(60)}, "c": "x"}, "d": np.array([1, "a"], object)}
    savemat(file, {**given, **log}, **options)
    return file.getvalue()


def _hdf5() -> bytes:
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w") as group:
        group["t"], group["q"], group["log/a"] = _columns()["t"], _columns()["q"], "text"
        group.create_dataset("tau", data=_columns()["tau"], chunks=True, compression="gzip", shuffle=True)
    return file.getvalue()


def _array(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _zipped(content: bytes) -> bytes:
    """Archive with this content as q_1."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("t", "tau_1"):
            archive.writestr(f"{name}.npy", _array(np.arange(90) / 9))
        archive.writestr("q_1.npy", content)
    return file.getvalue()
