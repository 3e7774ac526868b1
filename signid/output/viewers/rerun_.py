"""Files of Rerun: a plot for each joint, texts, and the robot."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...robot.description.document import children, parse
from ...robot.locate import find_mesh
from .links import QUANTITIES, Findings, Head, Links, Remark, Signal, drawn_urdf

TITLES = {  # of groups of curves
    "effort": "torque [N.m] or force [N]",
    "position": "position [rad or m]",
    "velocity": "velocity [rad/s or m/s]",
}
AFTER = 1.0  # [s] that the arrow of the largest moment stays after the end of a contact
COLOUR = (0.9, 0.1, 0.1)
TOGETHER = 200  # rows


class RerunFile:
    """Holds a file in memory until it is closed: Rerun's own writer hides errors of a full disk."""

    def __init__(self, out: IO[bytes], head: Head, package_dirs: Sequence[str]) -> None:
        import rerun as rr

        self.rr, self.out, self.head, self.package_dirs = rr, out, head, package_dirs
        self.stream = rr.RecordingStream("signid", recording_id=head.identity, send_properties=False)
        self.buffer = self.stream.binary_stream()
        self.stream.send_recording_name(head.title)
        self.links: Links | None = None
        self.kept: list[Sequence[Signal]] = []
        self.groups: dict[tuple[str, ...], dict[str, Any]] = {}  # path of the plot of each joint
        self.texts = ""

    def robot(self, _t: float, links: Links) -> None:
        """Write the robot with its meshes; from now on positions move the links."""
        from rerun.urdf import UrdfTree

        self.links = links
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch, "robot.urdf")
            path.write_bytes(_with_meshes(drawn_urdf(links), links.robot.path, self.package_dirs))
            UrdfTree.from_file_path(path).log_urdf_to_recording(self.stream)
        self.stream.log("contact", self.rr.CoordinateFrame(links.root), static=True)

    def signals(self, signals: Sequence[Signal]) -> None:
        """Keep signals, and write many rows together: Rerun stores each piece with a head of a kilobyte."""
        self.kept.append(signals)
        if sum(len(each[0].t) for each in self.kept) >= TOGETHER:
            self._write()

    def findings(self, found: Findings) -> None:
        """Write verdict and findings as a list of texts and as a summary."""
        rr, self.texts = self.rr, "findings"
        texts = [found.verdict, *(f"{mark.title}: {'; '.join(mark.lines)}" for mark in found.marks)]
        levels = ["WARN" if x else "INFO" for x in (bool(found.marks), *(mark.cause for mark in found.marks))]
        times = [found.t, *(found.t if mark.time is None else mark.time[0] for mark in found.marks)]
        text = "\n- ".join([*texts, *(f"note: {note}" for note in self.head.notes)])
        self.stream.log("summary", rr.TextDocument(text, media_type="text/markdown"), static=True)
        columns = rr.TextLog.columns(text=texts, level=levels)
        self.stream.send_columns("findings", indexes=[self._times(np.array(times))], columns=columns)

    def remark(self, remark: Remark) -> None:
        """Write an event as text, and its arrow."""
        rr, arrow, self.texts = self.rr, remark.arrow, "events"
        self.stream.set_time("time", duration=remark.t)
        self.stream.log("events", rr.TextLog(remark.sentence, level="WARN" if remark.warning else "INFO"))
        if arrow is not None:
            look, tip, way = {"radii": arrow.radius, "colors": COLOUR}, arrow.tip, arrow.way
            shape = (
                rr.Points3D([tip], **look) if way is None else rr.Arrows3D(origins=[tip - way], vectors=[way], **look)
            )
            self.stream.log("contact", rr.Clear(recursive=False))
            if not arrow.removed:
                self.stream.log("contact", shape)
            if arrow.ended:
                self.stream.set_time("time", duration=remark.t + AFTER)
                self.stream.log("contact", rr.Clear(recursive=False))

    def close(self) -> None:
        """Write the file. What a stream gave in pieces would be no file, so it is read once."""
        self._write()
        self.stream.send_blueprint(self._layout())
        self.out.write(self.buffer.read() or b"")
        self.stream.disconnect()

    def _times(self, t: Any) -> Any:
        return self.rr.TimeColumn("time", **{"timestamp" if self.head.dated else "duration": t})

    def _write(self) -> None:
        """Write curves and poses of links of the signals that are kept."""
        for pieces in zip(*self.kept, strict=True):
            one, t = pieces[0], np.concatenate([each.t for each in pieces])
            for quantity in (name for name in QUANTITIES if getattr(one, name) is not None):
                values = np.concatenate([getattr(each, quantity) for each in pieces])
                self._curves(one.joints, one.curves[quantity], t, values)
                if quantity == "position" and one.drawn and self.links is not None:
                    self._poses(self.links, t, values)
        self.kept = []

    def _curves(self, joints: Sequence[str], place: tuple[str, ...], t: Any, values: Any) -> None:
        rr, group = self.rr, self.groups.setdefault(place[:-1], {})
        for j, joint in enumerate(joints):
            known = np.isfinite(values[:, j])
            group[joint] = rr.new_entity_path([*place[:-1], joint])
            if known.any():
                path = rr.new_entity_path([*place[:-1], joint, place[-1]])
                columns = rr.Scalars.columns(scalars=values[known, j])
                self.stream.send_columns(path, indexes=[self._times(t[known])], columns=columns)

    def _poses(self, links: Links, t: Any, q: Any) -> None:
        known = np.isfinite(q).all(axis=1)
        for poses in zip(*map(links.poses, q[known]), strict=True):
            parent, child, place, turn = zip(*poses, strict=True)
            frames = {"parent_frame": parent, "child_frame": child}
            moved = self.rr.Transform3D.columns(translation=place, quaternion=turn, **frames)
            path = self.rr.new_entity_path(["links", child[0]])
            self.stream.send_columns(path, indexes=[self._times(t[known])], columns=moved)

    def _layout(self) -> Any:
        """The robot beside a tab for each group of curves, with a plot for each joint; texts below."""
        import rerun.blueprint as blueprint

        tabs = []
        for group, paths in self.groups.items():
            quantity, _, rest = group[-1].partition("_")
            title = " ".join(filter(None, (*group[:-1], TITLES.get(quantity, quantity), rest)))
            plots = [blueprint.TimeSeriesView(origin=path, name=joint) for joint, path in paths.items()]
            tabs.append(blueprint.Grid(*plots, name=title))
        drawn = [blueprint.Spatial3DView(origin="/", name="robot")] if self.links else []
        above = blueprint.Horizontal(*drawn, blueprint.Tabs(*tabs))
        below = [blueprint.TextLogView(origin=self.texts, name=self.texts)] if self.texts else []
        whole = blueprint.Vertical(above, *below, row_shares=[4, 1][: 1 + len(below)])
        return blueprint.Blueprint(whole, auto_layout=False, auto_views=False)


def _with_meshes(text: str, description: str, package_dirs: Sequence[str]) -> bytes:
    """URDF with the mesh files that signid finds, not the others, and no collision shapes beside visual ones."""
    from lxml import etree

    root = parse(text)
    for link in children(root, "link"):
        for shape in children(link, "collision") if children(link, "visual") else ():
            link.remove(shape)
    for mesh in list(root.iter("mesh")):
        if (path := find_mesh(mesh.get("filename", ""), description, package_dirs)) is not None:
            mesh.set("filename", str(path.absolute()))
        else:  # Rerun would warn on the terminal
            shape = mesh.getparent().getparent()
            shape.getparent().remove(shape)
    return bytes(etree.tostring(root))
