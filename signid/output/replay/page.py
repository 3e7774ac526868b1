"""Self-contained HTML file of a replay: Meshcat's viewer, shapes, motion and player; and a local server of it."""

from __future__ import annotations

import json
from base64 import b64encode
from dataclasses import asdict, dataclass
from html import escape
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Robot
from ..report.documents import rms
from ..report.layout import content_policy, position_units, torque_units
from .live import Live
from .marks import Mark
from .shapes import Look
from .track import Track

PAGE_FOLDER = Path(__file__).parent
SCRIPTS = ("scene.js", "colours.js", "curves.js", "player.js")
OUTLINE_POSES, OUTLINE_DIRECTIONS = 80, 400  # number of poses and of directions for the search of outermost points
COLOUR_SCALE_QUANTILE = 0.98  # quantile of the torque residuals covered by the colour scale


@dataclass(frozen=True, eq=False)
class Replay(Frozen):
    """A recorded robot and its simulations: M simulations, F frames, b bodies."""

    robot: Robot
    title: str
    look: Look
    bodies: tuple[int, ...]  # joints of the model that carry the drawn bodies, 0: base
    movers: tuple[int, ...]  # joint that moves each body, -1: base
    track: Track
    recorded: Array  # (F, b, 7) position [m] and quaternion x, y, z, w [1]
    simulated: Array  # (M, F, b, 7) [m, 1]; NaN outside of roll-outs
    marks: tuple[Mark, ...]
    verdict: str  # verdict of the diagnosis; "" without one
    headline: str  # the same in a sentence
    horizon: float | None  # length of a roll-out [s]; None: the whole recording
    reach: float  # [m]
    notes: tuple[str, ...]
    commanded: Array | None = None  # (F, b, 7) [m, 1] at the commands of position drives
    origin: float = 0.0  # [s] time stamp from which the page and the terminal count

    def page(self) -> str:
        """Render a self-contained HTML file, reproducible to the byte.

        Raises:
            OptionError: the package meshcat is not installed.
        """
        blob = _Blob()
        content = _content(self, blob)
        player = "\n".join(['"use strict";', *((PAGE_FOLDER / name).read_text(encoding="utf-8") for name in SCRIPTS)])
        spec = find_spec("meshcat")  # whose viewer is read without importing it
        path = Path(str(spec.origin)).parent / "viewer" / "dist" / "main.min.js" if spec and spec.origin else None
        if path is None or not path.is_file():
            raise OptionError(
                "the package meshcat, whose viewer the page contains, is not installed; pip install meshcat"
            )
        viewer = path.read_text(encoding="utf-8").replace("</script", "<\\/script")
        filled = {
            "POLICY": content_policy([viewer, player]),
            "TITLE": escape(self.title),
            "STYLE": (PAGE_FOLDER / "page.css").read_text(encoding="utf-8"),
            "MESHCAT": viewer,
            "CONTENT": json.dumps(content, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c"),
            "BLOB": blob.text(),
            "PLAYER": player,
        }
        pieces = (PAGE_FOLDER / "page.html").read_text(encoding="utf-8").split("%%")
        return "".join(filled.get(piece, piece) for piece in pieces)

    def document(self) -> dict[str, Any]:
        """Residual torque and position error of the original and the extended simulation, as JSON."""
        track = self.track
        loop = track.command is not None
        strayed = track.simulated - track.recorded
        return {
            "schema": "signid.replay/1",
            "robot": self.robot.name,
            "joints": list(self.robot.joints),
            "unit": position_units(self.robot),
            **({} if loop else {"torque_unit": torque_units(self.robot)}),
            "start": float(track.t[0]),
            "end": float(track.t[-1]),
            **({"time_origin": self.origin} if self.origin else {}),
            "frames": len(track.t),
            "horizon": self.horizon,
            **({} if loop else {"residual_rms": [rms(residual).tolist() for residual in track.residual]}),
            **({} if track.command is None else {"command_rms": rms(track.command - track.recorded).tolist()}),
            "strayed_rms": [rms(error).tolist() for error in strayed],
            "apart": track.apart.mean(axis=1).tolist(),
            "marks": [asdict(mark) for mark in self.marks],
            "notes": list(self.notes),
        }

    def show(self) -> Live:
        """Start a local Meshcat viewer that other programs can draw into."""
        return Live(self.page())


class _Blob:
    """Concatenated arrays, each aligned to four bytes."""

    def __init__(self) -> None:
        self.data = bytearray()

    def put(self, values: Any, kind: str) -> dict[str, Any]:
        """Append an array as f4, u4 or i2, little-endian; return its place."""
        data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
        place = {"at": len(self.data), "count": int(np.size(values)), "kind": kind}
        self.data += data + b"\0" * (-len(data) % 4)
        return place

    def text(self) -> str:
        return b64encode(self.data).decode("ascii")


def _content(replay: Replay, blob: _Blob) -> dict[str, Any]:
    track, robot, bodies = replay.track, replay.robot, list[dict[str, Any]]()
    size, units = np.abs(track.residual[0]), torque_units(robot) if track.command is None else position_units(robot)
    scale = {unit: _round(size[:, np.array(units) == unit]) for unit in dict.fromkeys(units)}
    outline = blob.put(_outline(replay), "f4")
    for body, joint in zip(replay.bodies, replay.movers, strict=True):
        bodies.append({"body": body, "joint": joint, "name": str(robot.model.names[body])})
        if shape := replay.look.bodies.get(body):
            bodies[-1] |= {"vertices": blob.put(shape.vertices, "f4"), "faces": blob.put(shape.faces, "u4")}
    return {
        "title": replay.title,
        "robot": robot.name,
        "verdict": replay.verdict,
        "headline": replay.headline,
        "notes": list(replay.notes),
        "horizon": replay.horizon,
        "reach": replay.reach,
        "outline": outline,
        "period": float(track.t[1] - track.t[0]) if len(track.t) > 1 else 1.0,
        "start": float(track.t[0]),
        "frames": len(track.t),
        "simulations": len(replay.simulated),
        "joints": [
            {"name": name, "unit": unit, "length": length, "torque": size if np.isfinite(size) else None}
            for name, unit, length, size in zip(
                robot.joints, units, position_units(robot), track.torque.tolist(), strict=True
            )
        ],
        "scale": {**scale, "share": _round(size / track.torque)},  # ends of the colours, by unit and of the rms
        "bodies": bodies,
        "recorded": blob.put(replay.recorded, "f4"),
        "simulated": [blob.put(poses, "f4") for poses in replay.simulated],
        "window": blob.put(track.window, "i2" if track.window.max(initial=0) < 2**15 else "u4"),
        "measured": blob.put(track.measured, "f4"),
        "position": blob.put(track.recorded, "f4"),
        "commanded": None if replay.commanded is None else blob.put(replay.commanded, "f4"),
        "command": None if track.command is None else blob.put(track.command, "f4"),
        "strayed": [blob.put(path, "f4") for path in track.simulated],
        "residual": [blob.put(residual, "f4") for residual in track.residual],
        "apart": [blob.put(flags, "i2") for flags in track.apart],
        "marks": [asdict(mark) for mark in replay.marks],
    }


def _outline(replay: Replay) -> Any:
    """Outermost points of the recorded robot, (k, 3) [m], for the choice of the view."""
    corners = []
    for body, shape in replay.look.bodies.items():
        k = replay.bodies.index(body)
        box = np.array(list(product(*zip(shape.vertices.min(axis=0), shape.vertices.max(axis=0), strict=True))))
        place = replay.recorded[:: max(1, len(replay.recorded) // OUTLINE_POSES), k]
        along, w = place[:, None, 3:6], place[:, None, 6:]
        twice = 2 * np.cross(along, box)
        corners.append((box + w * twice + np.cross(along, twice) + place[:, None, :3]).reshape(-1, 3))
    points = np.concatenate(corners)
    height = np.linspace(-1, 1, OUTLINE_DIRECTIONS)  # directions on a spiral around a sphere
    turn = np.pi * (1 + 5**0.5) * np.arange(OUTLINE_DIRECTIONS)
    wide = np.sqrt(1 - height**2)
    ways = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), height])
    return points[np.unique(np.argmax(points @ ways.T, axis=0))]


def _round(size: Any) -> float:
    """Round up a high quantile of the values to 1, 2, 5, 10, ..."""
    known = size[np.isfinite(size)]
    top = float(np.quantile(known, COLOUR_SCALE_QUANTILE)) if len(known) else 1.0
    power = 10.0 ** np.floor(np.log10(top)) if top > 0 else 1.0
    return float(next(power * step for step in (1, 2, 5, 10) if power * step >= top * (1 - 1e-9)))
