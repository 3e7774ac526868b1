"""LeRobot datasets: Parquet files of one or several episodes, described by meta/info.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from ...errors import RecordingError, shorten
from ...toml_json import read_json
from ...types import Array, Table
from ..vocabulary import VOCABULARY
from .base import BROKEN, About, Format, MemoryTable, hushed, require_memory

MEASURED = ("velocity", "effort", "torque", "current", "pwm", "voltage", "temperature")
KINDS = {  # kind of column by feature
    "observation.state": "q",
    **{f"observation.{word}": VOCABULARY[word].kind for word in MEASURED},
    "action": "q_des",
}
ENDINGS = {word: VOCABULARY[word].kind for word in ("pos", "vel", *MEASURED)}  # kind by suffix: elbow.pos
TIMES = 6  # peak memory while reading [times the size of the numbers]
DEPTH = 2  # number of folders between the dataset and a file: data/chunk-000
BREAK = 1.0, 10.0  # gap between two episodes, the longer of [s] and [frames]
IDEAL = 1e-4  # [s] tolerance between time stamps and frame index / fps


class LeRobot(Format):
    """Read completely, without images; gaps between the episodes split the recording."""

    name, suffixes = "lerobot", (".parquet",)
    description = "LeRobot dataset: its folder, or one of its Parquet files"

    def recognises(self, path: Path) -> bool:
        return (path.is_dir() or super().recognises(path)) and _home(path) is not None

    def files(self, path: Path) -> Sequence[Path]:
        home = _home(path) or path
        tables = sorted(home.glob("data/*/*.parquet")) if path.is_dir() else [path]
        return [home / "meta" / "info.json", *(table for table in tables if table.is_file())]

    def open(self, path: Path) -> Table:
        described, *tables = self.files(path)
        info = _info(described)
        if not tables:
            raise RecordingError(f"{path} has meta/info.json but no tables data/*/*.parquet; copy the dataset again")
        try:
            with hushed():
                frames: list[pl.DataFrame] = []
                for table in tables:
                    scan = pl.scan_parquet(table, glob=False)
                    wanted = (*KINDS, "timestamp", "frame_index", "episode_index")
                    chosen = scan.select(name for name in scan.collect_schema().names() if name in wanted)
                    rows = scan.select(pl.len()).collect().item()
                    size = TIMES * rows * chosen.head(1).collect().estimated_size()
                    require_memory(table, size, "give fewer episodes at a time")
                    frames.append(chosen.collect())
                frame = pl.concat(frames, how="diagonal_relaxed")
            if not frame.height:
                raise RecordingError(f"{path} has tables without rows; record an episode, or copy the dataset again")
            return _table(path, frame, info)
        except BROKEN as error:
            raise RecordingError(f"{path} is not a valid LeRobot dataset, or is cut short; copy it again") from error


def _home(path: Path) -> Path | None:
    """Folder of the dataset of a path."""
    places = [path] if path.is_dir() else path.absolute().parents[DEPTH : DEPTH + 1]
    return next((place for place in places if (place / "meta" / "info.json").is_file()), None)


def _info(path: Path) -> Mapping[str, Any]:
    try:
        info = read_json(path)
        features = info["features"]
        if 0 < float(info["fps"]) < np.inf and all(isinstance(feature, Mapping) for feature in features.values()):
            return dict(info)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError):
        pass
    raise RecordingError(f"{path} is not a valid LeRobot description with fps and features; copy the dataset again")


def _table(path: Path, frame: pl.DataFrame, info: Mapping[str, Any]) -> MemoryTable:
    order = [name for name in ("episode_index", "frame_index") if name in frame.columns]
    frame = frame.sort(order) if order else frame
    t, notes, episodes = _time(path, frame, float(info["fps"]))
    columns: dict[str, Array] = {}
    for feature in KINDS:
        if feature in frame.columns:
            values = _matrix(path, frame[feature])
            names = info["features"].get(feature, {}).get("names")
            while isinstance(names, Mapping):
                names = next(iter(names.values()), None)
            listed = isinstance(names, list) and all(isinstance(name, str) for name in names)
            if not names or not listed or len(names) != values.shape[1]:
                names = [str(k + 1) for k in range(values.shape[1])]
                notes += (f"{feature} has no names in meta/info.json: assigned to joints 1 to {len(names)} in turn",)
            for name, value in zip(names, values.T, strict=True):
                kind = KINDS[feature]
                joint, dot, ending = name.rpartition(".")
                stated = ENDINGS.get(ending, "") if dot else ""
                if stated in ("", "q"):
                    column = f"{kind}_{joint if stated else name}"
                else:
                    column = f"action_{name}" if kind == "q_des" else f"{stated}_{joint}"
                columns.setdefault(column, value)
    if not any(name.startswith("q_") and not name.startswith("q_des_") for name in columns):
        raise RecordingError(f"{path} has no observation.state; give a dataset that records the joints")
    if not any(name.startswith(("tau_", "current_")) for name in columns):
        servo = any(name.startswith("q_des_") for name in columns)
        how = "it is a recording of servos, with actions as commanded positions"
        consequence = how if servo else "so identification is not possible"
        notes += (f"no torque and no current was recorded{': ' if servo else ', '}{consequence}",)
    about = About(notes, frozenset(columns), clock="the dataset's own", episodes=episodes)
    return MemoryTable({"t": t, **columns}, {}, str(path), about)


def _time(path: Path, frame: pl.DataFrame, fps: float) -> tuple[Array, tuple[str, ...], tuple[tuple[float, str], ...]]:
    """Time (N,) [s] of the rows, notes, and the first time [s] and the name of each episode."""
    number = _plain(frame, "frame_index")
    t = _plain(frame, "timestamp") if "timestamp" in frame.columns else None
    if t is None and number is None:
        raise RecordingError(f"{path} has neither timestamp nor frame_index; give a LeRobot dataset")
    notes: tuple[str, ...] = ()
    if number is not None and (t is None or np.all(np.abs(t - number / fps) < IDEAL)):
        t = number / fps
        notes = (f"time is the frame index at {fps:g} Hz, as LeRobot writes it, not the time of measurement",)
    assert t is not None, "one of the two is there"
    known = _plain(frame, "episode_index")
    episode = np.zeros(len(t)) if known is None else known
    starts = np.flatnonzero(np.diff(episode, prepend=np.nan) != 0)
    ends = np.append(starts[1:], len(t))
    clock, t = 0.0, t.copy()
    for start, end in zip(starts, ends, strict=True):
        t[start:end] += clock - t[start]
        clock = t[end - 1] + max(BREAK[0], BREAK[1] / fps)
    if len(starts) > 1:
        shown = shorten([f"{number:.0f}" for number in episode[starts]])
        notes += (f"{len(starts)} episodes ({shown}) follow each other with gaps between them",)
    episodes = zip(t[starts].tolist(), episode[starts].tolist(), strict=True)
    return t, notes, tuple((first, f"episode {number:.0f}") for first, number in episodes)


def _plain(frame: pl.DataFrame, name: str) -> Array | None:
    return frame[name].cast(pl.Float64).to_numpy() if name in frame.columns else None


def _matrix(path: Path, series: pl.Series) -> Array:
    """Matrix (N, n) [any] of a column of lists or numbers."""
    if series.dtype.is_numeric():
        return series.cast(pl.Float64).to_numpy()[:, None]
    if not (isinstance(series.dtype, pl.List | pl.Array) and series.dtype.inner.is_numeric()):
        raise RecordingError(f"{path}: {series.name} holds {series.dtype}, expected a list of numbers in each row")
    lists = series.cast(pl.List(pl.Float64))
    sizes = lists.list.len().unique().to_list()
    if len(sizes) != 1 or not sizes[0]:
        raise RecordingError(f"{path}: {series.name} holds lists of different lengths; correct the dataset")
    return np.asarray(lists.list.to_array(sizes[0]).to_numpy()).reshape(-1, sizes[0])


PLUGIN = LeRobot()
