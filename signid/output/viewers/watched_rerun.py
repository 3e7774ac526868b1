"""A watch as a recording of Rerun: the robot, curves, events and arrows of contacts."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...model import Model
from ...robot.description.document import children, parse
from ...robot.locate import find_mesh
from ...watch import Contact, Event, WatchedBlocks
from .links import drawn_urdf
from .watched import AFTER, COLOUR, THICK, WARN, Scene, level

CURVES = ("measured", "predicted", "residual", "threshold")  # of one plot for each joint, beside q and v
TOGETHER = 200  # rows


class WatchRerun:
    """Collects a file of Rerun, which is written at the end: Rerun's own writer hides errors of a full disk."""

    def __init__(self, file: IO[bytes], model: Model, package_dirs: Sequence[str] = ()) -> None:
        import rerun as rr

        self.rr, self.scene, self.joints = rr, Scene(model), model.robot.joints
        self.kept: list[WatchedBlocks] = []
        self.stream = rr.RecordingStream("signid", send_properties=False)
        self.file, self.buffer = file, self.stream.binary_stream()
        self.stream.send_blueprint(self._layout())
        self.stream.send_recording_name(f"watch of {model.robot.name}")
        self._robot(package_dirs)

    def rows(self, rows: WatchedBlocks) -> None:
        """Keep rows, and write many together: Rerun stores each piece with a head of a kilobyte."""
        self.kept.append(rows)
        self.scene.q = rows.q[-1]
        if sum(len(each.t) for each in self.kept) >= TOGETHER:
            self._write()

    def _write(self) -> None:
        """Write curves and poses of links of the rows that are kept."""
        rr, joined = self.rr, (np.concatenate(x) for x in zip(*self.kept, strict=True))
        rows, self.kept = WatchedBlocks(*joined), []
        index = [rr.TimeColumn("time", duration=rows.t)]
        for name in ("q", "v", *CURVES):
            values = getattr(rows, name)
            for j, joint in enumerate(self.joints):
                path = rr.new_entity_path([name if name in "qv" else "torque", joint, name])
                self.stream.send_columns(path, indexes=index, columns=rr.Scalars.columns(scalars=values[:, j]))
        for link in zip(*map(self.scene.links.poses, rows.q), strict=True):
            parent, child, place, turn = zip(*link, strict=True)
            frames = {"parent_frame": parent, "child_frame": child}
            moved = rr.Transform3D.columns(translation=place, quaternion=turn, **frames)
            self.stream.send_columns(rr.new_entity_path(["links", child[0]]), indexes=index, columns=moved)

    def event(self, event: Event, sentence: str) -> None:
        """Write an event as text; a contact also as an arrow."""
        rr = self.rr
        self.stream.set_time("time", duration=event.t)
        self.stream.log("events", rr.TextLog(sentence, level="WARN" if level(event) == WARN else "INFO"))
        if isinstance(event, Contact):
            (tip, way), look = self.scene.arrow(event), {"radii": THICK * self.scene.reach, "colors": COLOUR}
            known = event.force is not None
            shape = rr.Arrows3D(origins=[tip - way], vectors=[way], **look) if known else rr.Points3D([tip], **look)
            self.stream.log("contact", rr.Clear(recursive=False))
            if not event.cause:
                self.stream.log("contact", shape)
            if event.end is not None:
                self.stream.set_time("time", duration=event.t + AFTER)
                self.stream.log("contact", rr.Clear(recursive=False))

    def close(self) -> None:
        """Complete the file."""
        if self.kept:
            self._write()
        self.file.write(self.buffer.read() or b"")
        self.stream.disconnect()

    def _robot(self, package_dirs: Sequence[str]) -> None:
        from rerun.urdf import UrdfTree

        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch, "robot.urdf")
            path.write_bytes(_with_meshes(drawn_urdf(self.scene.links), self.scene.robot.path, package_dirs))
            UrdfTree.from_file_path(path).log_urdf_to_recording(self.stream)
        self.stream.log("contact", self.rr.CoordinateFrame(self.scene.links.root), static=True)

    def _layout(self) -> Any:
        """The robot beside tabs of plots for each joint; events below."""
        import rerun.blueprint as blueprint

        tabs = []
        for group in ("torque", "q", "v"):
            paths = [(joint, self.rr.new_entity_path([group, joint])) for joint in self.joints]
            plots = [blueprint.TimeSeriesView(origin=path, name=joint) for joint, path in paths]
            tabs.append(blueprint.Grid(*plots, name=group))
        above = blueprint.Horizontal(blueprint.Spatial3DView(origin="/", name="robot"), blueprint.Tabs(*tabs))
        below = blueprint.TextLogView(origin="events", name="events")
        return blueprint.Blueprint(blueprint.Vertical(above, below, row_shares=[4, 1]), auto_views=False)


def _with_meshes(text: str, description: str, package_dirs: Sequence[str]) -> bytes:
    """URDF with the paths of mesh files that signid finds, without collision shapes beside visual ones."""
    from lxml import etree

    root = parse(text)
    for link in children(root, "link"):
        for shape in children(link, "collision") if children(link, "visual") else ():
            link.remove(shape)
    for mesh in root.iter("mesh"):
        if (path := find_mesh(mesh.get("filename", ""), description, package_dirs)) is not None:
            mesh.set("filename", str(path.absolute()))
    return bytes(etree.tostring(root))
