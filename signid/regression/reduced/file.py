"""Factor files: sums of rows with their task, in a bounded archive."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from ...effects import EFFECTS
from ...errors import OptionError, RobotError, SignidError
from ...recording.formats.npz import HEADER
from ...robot import described_gravity, hold, resting
from ...typed import typed
from ...types import Array, BaseMap, Indices, Input, Law, Robot
from ...version import __version__
from ..bandwidth import Band
from ..factors import SAMPLED, Factors, JointFactors, Node, RowSample, reduce_rows
from ..motion import labels
from ..rows import Task
from .plausible import (
    ImplausibleError,
    check_band,
    check_base,
    check_files,
    check_laws,
    check_places,
    check_sums,
    whole_number,
)
from .reduce import WHOLE, Reduced

SCHEMA = "signid.factors/1"
LARGEST, LARGEST_HEADER = 2**30, 2**24  # [bytes] size of all arrays and of the header: for damaged and malicious files
BASE = ("combination", "sees", "singular_values", "independent")
BAND = ("per_joint", "velocity_noise", "torque_floor")
MOTION = ("lower", "upper", "velocity", "acceleration")
JOINT = ("grams", "counts", "whole")
SUMS = ("train", "held_out")
FLAGS = ("recorded_derivatives", "instruments")


def read_archive(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of an undamaged file of factors.

    Raises:
        OptionError: the file cannot be read, is damaged, or has another version.
    """
    if path.exists() and not path.is_file():
        raise OptionError(f"cannot read factors from {path}: it is no regular file")
    try:
        header, arrays = _unpacked(path)
        schema, whole = header["schema"], header["sha256"] == hash_of(arrays)
    except MemoryError:
        raise OptionError(
            f"{path} expands to more than {LARGEST >> 30} GiB, and factors are far smaller; reduce the recordings again"
        ) from None
    except Exception as error:  # errors of the system, of numpy, of zip archives and of the header's content
        if isinstance(error, OSError) and error.strerror:
            raise OptionError(f"cannot read factors from {path}: {error.strerror}") from None
        raise damaged(path) from error
    if schema != SCHEMA:
        raise OptionError(f"{path} holds {schema!r}; expected {SCHEMA!r}; reduce the recordings again")
    if not whole:
        raise damaged(path)
    return header, arrays


def _unpacked(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of an archive of limited size."""
    with ZipFile(path) as archive:
        sizes = {member.filename: member.file_size for member in archive.infolist()}
        if sum(sizes.values()) > LARGEST or sizes.get(f"{HEADER}.npy", 0) > LARGEST_HEADER:
            raise MemoryError
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays.pop(HEADER).tobytes())
    return header, arrays


def damaged(path: str | Path) -> OptionError:
    """Error about a file that is no file of factors."""
    return OptionError(
        f"{path} is not a file of factors as `signid reduce` writes it, or is damaged; reduce the recordings again"
    )


def hash_of(arrays: Mapping[str, Any]) -> str:
    """Hash of arrays by name."""
    digest = sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


@typed
def encode_factors(reduced: Reduced) -> bytes:
    """Content of a file of factors; equal factors give equal bytes.

    Args:
        reduced: factors by `reduce`.
    """
    task, band, base = reduced.task, reduced.task.band, reduced.task.base
    arrays: dict[str, Any] = {f"base_{name}": np.asarray(getattr(base, name)) for name in BASE}
    arrays |= {f"band_{name}": np.asarray(getattr(band, name)) for name in BAND}
    sums = {name: getattr(reduced, name) for name in SUMS}
    arrays |= {
        f"{name}_{k}_{key}": array
        for name, nodes in sums.items()
        for k, node in enumerate(nodes)
        for key, array in _arrays(node.factors).items()
    }
    arrays["slow"] = task.slow
    header = {
        "schema": SCHEMA,
        "version": __version__,
        "robot": {"name": task.robot.name, "sha256": _digest(task.robot)},
        "joints": list(task.robot.joints),
        "laws": [[law.effect.name, list(law.joints)] for law in task.laws],
        "base": {"expressions": list(base.expressions), "units": list(base.units), "condition": base.condition},
        "band": {"rate": band.rate, "factor": band.factor, "filtered": band.filtered, "beyond": band.beyond},
        "reach": list(task.reach),
        **{name: getattr(task, name) for name in FLAGS},
        "share": list(reduced.share),
        "sums": {name: [[node.start, node.level] for node in nodes] for name, nodes in sums.items()},
        "inputs": [file._asdict() for file in reduced.inputs],
        "notes": list(reduced.notes),
        "sha256": hash_of(arrays),
    }
    text = np.frombuffer(json.dumps(header, ensure_ascii=False).encode("utf-8", "replace"), np.uint8)
    archive = io.BytesIO()
    np.savez_compressed(archive, allow_pickle=False, **{HEADER: text}, **arrays)
    return archive.getvalue()


@typed
def load_factors(path: str | Path, robot: Robot) -> Reduced:
    """Read the factors in a file.

    Args:
        path: file that `signid reduce` wrote.
        robot: robot of the recordings, with the same joints held.

    Raises:
        RobotError: the factors are of another robot, or of other held joints.
        OptionError: the file cannot be read, is damaged, has another version, or holds what no recording gives.
    """
    header, arrays = read_archive(Path(path))
    try:
        joints = header["joints"]
        known = all(joint in robot.joints for joint in joints) and joints
        moving = hold(robot, resting(robot, but=joints)) if known else robot
        if not known or _digest(moving) != header["robot"]["sha256"]:
            name = header["robot"]["name"]
            raise RobotError(
                f"{path} holds factors of {name}, which differs from {robot.name} as given here; "
                f"give the description, --joints, --lock, --gravity and torque constants of the reduction"
            )
        check_laws(header["laws"], moving)
        check_files(header["inputs"], header["notes"])
        check_places((), header["share"])
        task = _task(header, arrays, moving)
        share = (int(header["share"][0]), int(header["share"][1]))
        train, held_out = (_nodes(name, header, arrays, task) for name in SUMS)
        inputs = tuple(Input(*(file[key] for key in Input._fields)) for file in header["inputs"])
        found = Reduced(task, train, held_out, inputs, tuple(header["notes"]), share)
        if share == WHOLE and not (len(train) == len(held_out) == 1 and train[0].factors.rows):
            raise damaged(path)
        return found
    except ImplausibleError as error:
        raise OptionError(f"{path} holds {error}, which no recording gives; reduce the recordings again") from None
    except SignidError:
        raise
    except Exception as error:  # any fault of the header's content
        raise damaged(path) from error


def _nodes(name: str, header: Mapping[str, Any], arrays: Mapping[str, Any], task: Task) -> tuple[Node, ...]:
    """Sums of the training or of the held-out rows."""
    places, share = header["sums"][name], header["share"]
    check_places(places, share)
    nodes = tuple(Node(start, level, _factors(f"{name}_{k}", arrays, task)) for k, (start, level) in enumerate(places))
    check_sums(nodes, task, tuple(share) == WHOLE)
    return nodes


def _digest(robot: Robot) -> str:
    """Hash of everything in a robot that rows depend on: description, held joints, torque constants, gravity."""
    digest = sha256(f"{robot.sha256} {robot.joints}".encode())
    arrays = [robot.rest, robot.drive, robot.actuators.torque_constant]
    gravity = np.array(robot.model.gravity.linear)
    if not np.array_equal(gravity, described_gravity(robot)):
        arrays.append(gravity)  # not otherwise: factors of earlier versions load
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _arrays(factors: Factors) -> dict[str, Any]:
    joints = {f"{j}_{key}": getattr(each, key) for j, each in enumerate(factors.joints) for key in JOINT}
    totals = np.array([[each.total, each.rows] for each in factors.joints] + [[0.0, factors.rows]])
    found: dict[str, Any] = {**joints, **{key: getattr(factors, key) for key in MOTION}, "totals": totals}
    if factors.sample is not None:
        sample = {key: getattr(factors.sample, key) for key in SAMPLED}
        single = {key: x.astype(np.float32) if x.dtype.kind == "f" else x for key, x in sample.items()}
        found |= {f"sample_{key}": x for key, x in single.items()}
        found["sample_stride"] = np.array(factors.sample.stride)
    return found


def _factors(part: str, arrays: Mapping[str, Any], task: Task) -> Factors:
    """Factors of one part, checked against the shapes of the task."""
    lags = len(arrays[f"{part}_0_grams"]) - 1
    like, totals = reduce_rows(task, (), lags), arrays[f"{part}_totals"]
    joints = []
    for j, empty in enumerate(like.joints):
        grams, counts, whole = (_same_shape(arrays[f"{part}_{j}_{key}"], getattr(empty, key)) for key in JOINT)
        joints.append(JointFactors(grams, counts, whole, float(totals[j, 0]), whole_number(totals[j, 1], "rows")))
    motion: dict[str, Any] = {key: _same_shape(arrays[f"{part}_{key}"], getattr(like, key)) for key in MOTION}
    return replace(
        like,
        joints=tuple(joints),
        rows=whole_number(totals[-1, 1], "rows"),
        sample=_sample(part, arrays, task, like.columns),
        **motion,
    )


def _sample(part: str, arrays: Mapping[str, Array], task: Task, seen: Sequence[Indices]) -> RowSample | None:
    """Sample of rows; None for files of earlier versions."""
    if f"{part}_sample_stride" not in arrays:
        return None
    found: dict[str, Any] = {key: arrays[f"{part}_sample_{key}"] for key in SAMPLED}
    wide, rows = (len(found["number"]), len(task.robot.joints)), found["columns"]
    whole = all(found[key].shape == wide for key in SAMPLED[1:-1])
    if not whole or rows.shape != (wide[0], sum(map(len, seen))) or found["number"].dtype.kind != "i":
        raise ValueError("a sample of rows does not have the shape of its task")
    found = {key: x.astype(np.float64) if x.dtype.kind == "f" else x for key, x in found.items()}
    period = task.band.factor / task.band.rate
    return RowSample(period=period, stride=int(arrays[f"{part}_sample_stride"]), **found)


def _same_shape(array: Array, other: Array) -> Array:
    if array.shape != other.shape or array.dtype != other.dtype:
        raise ValueError("an array does not have the shape of its task")
    return array


def _task(header: Mapping[str, Any], arrays: Mapping[str, Any], robot: Robot) -> Task:
    laws = tuple(Law(EFFECTS[name], tuple(joints)) for name, joints in header["laws"])
    stated = header["base"]
    base = BaseMap(
        labels(robot, laws),
        expressions=tuple(map(str, stated["expressions"])),
        units=tuple(map(str, stated["units"])),
        condition=float(stated["condition"]),
        **{name: arrays[f"base_{name}"] for name in BASE},
    )
    stated, n = header["band"], len(robot.joints)
    band = Band(
        float(stated["rate"]),
        int(stated["factor"]),
        bool(stated["filtered"]),
        beyond=float(stated["beyond"]),
        **{name: arrays[f"band_{name}"] for name in BAND},
    )
    reach = tuple(int(x) for x in header["reach"])
    shapes = [base.combination.shape, base.sees.shape, arrays["slow"].shape, (len(reach),), band.per_joint.shape]
    whole = (
        base.independent.dtype.kind == "i" and base.sees.dtype == bool and 0 < band.rate < np.inf and band.factor > 0
    )
    names = len(base.expressions) == len(base.units) == base.rank
    if shapes != [(base.rank, len(base.labels)), (n, base.rank), (n,), (n,), (n,)] or not (whole and names):
        raise ValueError("the arrays do not fit the header")
    check_base(base)
    check_band(band, reach, arrays["slow"])
    return Task(robot, laws, base, band, arrays["slow"], reach, *(header[name] is True for name in FLAGS))
