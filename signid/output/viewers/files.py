"""Files that take messages: MCAP, and Rerun, which reads the same messages. Their libraries are optional."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from ...errors import OptionError
from ...robot.description.document import children, parse
from ...robot.locate import find_mesh
from ...types import Robot
from .links import QUANTITIES, Head, Signal
from .messages import McapFile

LIBRARIES = {"rrd": ("rerun", "mcap", "rosbags"), "mcap": ("mcap", "rosbags")}  # modules by kind of log
NAMES = {"rerun": "rerun-sdk"}  # package of a module, if it has another name
DECODERS = ("ros2_reflection", "ros2msg")  # of Rerun: transforms and texts, joint states
TITLES = {  # of plots
    "effort": "torque [N.m] or force [N]",
    "position": "position [rad or m]",
    "velocity": "velocity [rad/s or m/s]",
}


def check_library(kind: str) -> None:
    """Check that the libraries of a kind of log, "rrd" or "mcap", are installed.

    Raises:
        OptionError: one is missing.
    """
    lacking = [NAMES.get(module, module) for module in LIBRARIES[kind] if find_spec(module) is None]
    if lacking:
        raise OptionError(
            f"writing .{kind} files needs {' and '.join(lacking)}, which is not installed; "
            f"install the viewers with: pip install 'signid[viewers]'"
        )


def log_file(kind: str, out: IO[bytes], head: Head, package_dirs: Sequence[str] = ()) -> McapFile:
    """Begin a file of a kind; it is complete when it is closed.

    package_dirs: folders of packages of meshes, which a file of Rerun contains.

    Raises:
        OptionError: a library is missing.
    """
    check_library(kind)
    return McapFile(out, head) if kind == "mcap" else RerunFile(out, head, package_dirs)


class RerunFile(McapFile):
    """Keeps the messages in a temporary file until it is closed, and has Rerun read them."""

    def __init__(self, out: IO[bytes], head: Head, package_dirs: Sequence[str]) -> None:
        self.out, self.package_dirs, self.scratch = out, package_dirs, TemporaryDirectory()
        self.place = Path(self.scratch.name, "messages.mcap")
        self.messages = self.place.open("wb")
        self.shown: dict[str, Signal] = {}  # a signal of each topic
        super().__init__(self.messages, head)

    def signals(self, signals: Sequence[Signal]) -> None:
        """Write signals, each with its plots."""
        self.shown |= {each.topic: each for each in signals}
        super().signals(signals)

    def close(self) -> None:
        """Write the file. Rerun's own writer hides errors of a full disk, and its pieces would be no file."""
        import rerun as rr
        from rerun.chunk import McapReader
        from rerun.urdf import UrdfTree

        with self.scratch:
            with self.messages:
                super().close()
            stream = rr.RecordingStream("signid", send_properties=False)
            buffer = stream.binary_stream()
            stream.send_recording_name(self.head.title)
            time = "timestamp_ns" if self.head.dated else "duration_ns"
            if self.links is not None:
                drawn = self.place.with_name("robot.urdf")
                drawn.write_bytes(_with_meshes(self.links.robot, self.package_dirs))
                shapes = (each for each in UrdfTree.from_file_path(drawn).stream() if each.entity_path != "/tf_static")
                stream.send_chunks(list(shapes))  # messages move the links
            stream.send_chunks(McapReader(self.place, timeline_type=time, decoders=DECODERS).stream())
            stream.send_blueprint(self._layout())
            self.out.write(buffer.read() or b"")
            stream.disconnect()

    def _layout(self) -> Any:
        """The robot beside a tab for each quantity, with a plot for each joint; texts below."""
        import rerun as rr
        import rerun.blueprint as blueprint

        plots: dict[str, dict[str, dict[str, Any]]] = {}  # looks of curves by tab, joint and path
        for topic, signal in self.shown.items():
            folder, _, name = topic.rpartition("/")
            for quantity in (key for key in QUANTITIES if getattr(signal, key) is not None):
                words = (folder.removeprefix("/signid"), TITLES[quantity], "residual" if "residual" in name else "")
                tab = plots.setdefault(" ".join(filter(None, words)), {})
                for joint in signal.joints:
                    only = [joint == other for other in signal.joints]
                    look = rr.SeriesLines.from_fields(names=[name] * len(only), visible_series=only)
                    tab.setdefault(joint, {})[f"{topic}/{quantity}"] = look
        tabs = [
            blueprint.Grid(
                *(blueprint.TimeSeriesView(name=joint, contents=[*own], overrides=own) for joint, own in tab.items()),
                name=title,
            )
            for title, tab in plots.items()
        ]
        drawn = []
        if self.links is not None:
            frame = blueprint.SpatialInformation(target_frame=self.links.root)
            drawn = [blueprint.Spatial3DView(origin="/", name="robot", spatial_information=frame)]
        above, below = blueprint.Horizontal(*drawn, blueprint.Tabs(*tabs)), blueprint.TextLogView(name="remarks")
        whole = blueprint.Vertical(above, below, row_shares=[4, 1])
        return blueprint.Blueprint(whole, auto_layout=False, auto_views=False)


def _with_meshes(robot: Robot, package_dirs: Sequence[str]) -> bytes:
    """URDF with the paths of meshes that are found, without other meshes and collision shapes beside visual ones."""
    from lxml import etree

    root = parse(robot.document)
    for link in children(root, "link"):
        for shape in children(link, "collision") if children(link, "visual") else ():
            link.remove(shape)
    for mesh in list(root.iter("mesh")):
        if (path := find_mesh(mesh.get("filename", ""), robot.path, package_dirs)) is not None:
            mesh.set("filename", str(path.absolute()))
        else:  # Rerun would warn on the terminal
            shape = mesh.getparent().getparent()
            shape.getparent().remove(shape)
    return bytes(etree.tostring(root))
