"""A replay as one HTML file: Meshcat's viewer, the shapes, the motion and a player, all of it inside."""

from __future__ import annotations

import json
from base64 import b64encode
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Robot
from .marks import Mark
from .shapes import Look
from .track import Track

if TYPE_CHECKING:
    from .live import Live

HERE = Path(__file__).parent
PARTS = ("scene.js", "colours.js", "player.js")
INSTANTS, DIRECTIONS = 80, 400  # of the motion, and around it, in which its outermost points are sought
SURE = 0.98  # share of the torque residuals that the scale of colours covers


@dataclass(frozen=True, eq=False)
class Replay(Frozen):
    """A recorded robot beside its simulation: M simulations, F frames, b bodies."""

    robot: Robot
    title: str
    look: Look
    bodies: tuple[int, ...]  # joints of the model that carry what is drawn, 0 for the base
    movers: tuple[int, ...]  # per body the joint that moves it, -1 for the base
    track: Track
    recorded: Array  # (F, b, 7) position [m] and quaternion x, y, z, w [1]
    simulated: Array  # (M, F, b, 7) [m, 1]; NaN where nothing is simulated
    marks: tuple[Mark, ...]
    verdict: str  # of the diagnosis, empty without one
    horizon: float  # [s] of a roll-out
    reach: float  # [m]
    notes: tuple[str, ...]

    def page(self) -> str:
        """One HTML file that needs nothing else; the same replay gives the same bytes."""
        return replay_page(self)

    def document(self) -> dict[str, Any]:
        """What it shows, in numbers: residual torque, and how far simulations stray, first as given, then extended."""
        track = self.track
        strayed = track.simulated - track.recorded
        return {
            "schema": "signid.replay/1",
            "robot": self.robot.name,
            "joints": list(self.robot.joints),
            "unit": ["m" if slides else "rad" for slides in self.robot.prismatic],
            "torque_unit": ["N" if slides else "N.m" for slides in self.robot.prismatic],
            "start": float(track.t[0]),
            "end": float(track.t[-1]),
            "frames": len(track.t),
            "horizon": self.horizon,
            "residual_rms": [_rms(residual).tolist() for residual in track.residual],
            "strayed_rms": [_rms(error).tolist() for error in strayed],
            "apart": track.apart.mean(axis=1).tolist(),
            "marks": [mark.document() for mark in self.marks],
            "notes": list(self.notes),
        }

    def show(self) -> Live:
        """Serve it on this machine, as a Meshcat viewer that other programs can draw into, until it is closed."""
        from .live import Live

        return Live(self.page())


def replay_page(replay: Replay) -> str:
    """A page that needs no network; the same replay gives the same bytes.

    Raises:
        OptionError: the meshcat package, whose viewer the page holds, is not installed.
    """
    blob = _Blob()
    content = _content(replay, blob)
    scripts = "\n".join((HERE / name).read_text(encoding="utf-8") for name in PARTS)
    filled = {
        "TITLE": escape(replay.title),
        "STYLE": (HERE / "page.css").read_text(encoding="utf-8"),
        "MESHCAT": _viewer(),
        "CONTENT": json.dumps(content, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c"),
        "BLOB": blob.text(),
        "PLAYER": scripts,
    }
    pieces = (HERE / "page.html").read_text(encoding="utf-8").split("%%")
    return "".join(filled.get(piece, piece) for piece in pieces)


class _Blob:
    """Arrays one after another, each at a multiple of four bytes."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def put(self, values: Any, kind: str) -> dict[str, Any]:
        """Where the array is kept, as f4, u4 or i2, little-endian."""
        data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
        place = {"at": self.size, "count": int(np.size(values)), "kind": kind}
        data += b"\0" * (-len(data) % 4)
        self.parts.append(data)
        self.size += len(data)
        return place

    def text(self) -> str:
        return b64encode(b"".join(self.parts)).decode("ascii")


def _content(replay: Replay, blob: _Blob) -> dict[str, Any]:
    track, robot = replay.track, replay.robot
    return {
        "title": replay.title,
        "robot": robot.name,
        "verdict": replay.verdict,
        "notes": list(replay.notes),
        "horizon": replay.horizon,
        "reach": replay.reach,
        "outline": blob.put(_outline(replay), "f4"),
        "period": float(track.t[1] - track.t[0]) if len(track.t) > 1 else 1.0,
        "start": float(track.t[0]),
        "frames": len(track.t),
        "simulations": len(replay.simulated),
        "joints": [
            {"name": name, "unit": "N" if slides else "N.m", "torque": rms if np.isfinite(rms) else None}
            for name, slides, rms in zip(robot.joints, robot.prismatic.tolist(), track.torque.tolist(), strict=True)
        ],
        "scale": _scale(replay),
        "bodies": [_body(replay, k, blob) for k in range(len(replay.bodies))],
        "recorded": blob.put(replay.recorded, "f4"),
        "simulated": [blob.put(poses, "f4") for poses in replay.simulated],
        "window": blob.put(track.window, "i2" if track.window.max(initial=0) < 2**15 else "u4"),
        "residual": [blob.put(residual, "f4") for residual in track.residual],
        "apart": [blob.put(flags, "i2") for flags in track.apart],
        "marks": [mark.document() for mark in replay.marks],
    }


def _body(replay: Replay, k: int, blob: _Blob) -> dict[str, Any]:
    body = replay.bodies[k]
    shape = replay.look.bodies.get(body)
    told: dict[str, Any] = {"body": body, "joint": replay.movers[k], "name": str(replay.robot.model.names[body])}
    if shape is None:
        return told
    return {**told, "vertices": blob.put(shape.vertices, "f4"), "faces": blob.put(shape.faces, "u4")}


def _outline(replay: Replay) -> Any:
    """Outermost points (k, 3) [m] of all that the recorded robot fills, so that a view can hold them."""
    corners = []
    for k, body in enumerate(replay.bodies):
        shape = replay.look.bodies.get(body)
        if shape is None:
            continue
        low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        place = replay.recorded[:: max(1, len(replay.recorded) // INSTANTS), k]
        corners.append((_rotated(place[:, None, 3:], box) + place[:, None, :3]).reshape(-1, 3))
    points = np.concatenate(corners)
    height = np.linspace(-1, 1, DIRECTIONS)  # of directions on a spiral around a ball
    turn = np.pi * (1 + 5**0.5) * np.arange(DIRECTIONS)
    wide = np.sqrt(1 - height**2)
    ways = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), height])
    return points[np.unique(np.argmax(points @ ways.T, axis=0))]


def _rotated(quaternion: Any, points: Any) -> Any:
    along, w = quaternion[..., :3], quaternion[..., 3:]
    twice = 2 * np.cross(along, points)
    return points + w * twice + np.cross(along, twice)


def _scale(replay: Replay) -> dict[str, float]:
    """Where the colours end: per unit of torque, and for shares of each joint's torque; round numbers."""
    size = np.abs(replay.track.residual[0])
    units = np.array(["N" if slides else "N.m" for slides in replay.robot.prismatic])
    found = {unit: _round(size[:, units == unit]) for unit in dict.fromkeys(units.tolist())}
    return {**found, "share": _round(size / replay.track.torque)}


def _round(size: Any) -> float:
    """The next of 1, 2, 5, 10, ... beyond most of the values."""
    known = size[np.isfinite(size)]
    top = float(np.quantile(known, SURE)) if len(known) else 1.0
    power = 10.0 ** np.floor(np.log10(top)) if top > 0 else 1.0
    return float(next(power * step for step in (1, 2, 5, 10) if power * step >= top * (1 - 1e-9)))


def _viewer() -> str:
    """Meshcat's viewer, read from its package without importing it."""
    spec = find_spec("meshcat")
    path = Path(str(spec.origin)).parent / "viewer" / "dist" / "main.min.js" if spec and spec.origin else None
    if path is None or not path.is_file():
        raise OptionError("the meshcat package is not installed, and the page holds its viewer; pip install meshcat")
    return path.read_text(encoding="utf-8").replace("</script", "<\\/script")


def _rms(values: Array) -> Array:
    """Root mean square of values (F, n) [any] over the frames that have them, (n,); NaN where none has."""
    known = np.isfinite(values)
    total = np.sum(np.where(known, values, 0.0) ** 2, axis=0)
    return np.asarray(np.sqrt(np.where(known.any(axis=0), total / np.maximum(1, known.sum(axis=0)), np.nan)))
