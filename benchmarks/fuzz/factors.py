"""Factors of the robot 1r: a file, and what changes its header and its arrays; the hash is right again."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Mapping
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import signid
from signid.recording import read_recording
from signid.regression.reduced.file import hash_of
from signid.types import Robot

LINES = b"train_0_0_grams scale 2 0\ntrain_0_0_counts put 1 3\nheader band.rate 0 100\nbase_combination noise 1 1\n"


@cache
def pendulum() -> Robot:
    """The robot 1r."""
    return signid.load_robot("1r")


@cache
def factors() -> bytes:
    """A file of factors."""
    robot, t = pendulum(), np.arange(0, 20, 0.01)
    columns = {"t": t, "q_1": np.sin(t) + np.sin(2.3 * t), "tau_1": np.cos(t) + np.sin(3 * t)}
    return signid.encode_factors(signid.reduce(robot, [read_recording(columns, robot)]))


def header_text() -> bytes:
    """Its header, as JSON."""
    with np.load(io.BytesIO(factors()), allow_pickle=False) as archive:
        return bytes(archive["header"].tobytes())


def with_header(content: bytes) -> bytes:
    """Factors with another header; the digest covers the arrays only, so a mutated header is read."""
    with np.load(io.BytesIO(factors()), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    file = io.BytesIO()
    np.savez(file, **{**arrays, "header": np.frombuffer(content, np.uint8)})
    return file.getvalue()


@cache
def _opened() -> tuple[dict[str, Any], dict[str, Any]]:
    with np.load(io.BytesIO(factors()), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return json.loads(arrays.pop("header").tobytes()), arrays


def changes() -> list[bytes]:
    """Seeds of `changed`."""
    header, arrays = _opened()
    # lines that change each array and each number of the header
    names = [name for name in arrays if name != "header"]
    operations = ("scale 2 -1", "put 1 1e300", "noise 3 1e3", "turn 0 0", "drop 1 0", "type 1 0", "put 0 nan")
    found = [f"{name} {operations[k % 7]}\n{name} {operations[(k + 3) % 7]}\n".encode() for k, name in enumerate(names)]
    keys = [f"header {key}.{inner} 1 -1\n".encode() for key in ("band", "base") for inner in header[key]]
    return [LINES, *found, *keys]


def changed(content: bytes) -> bytes:
    """Factors with changed arrays and the hash of these."""
    header, arrays = deepcopy(_opened())
    # apply changes to the arrays and the header of factors; a line is ARRAY OPERATION PLACE NUMBER
    for line in content.decode("utf-8", "replace").splitlines()[:20]:
        words = line.split()
        with contextlib.suppress(ValueError, OverflowError, KeyError, IndexError, TypeError):
            _change(header, arrays, words)
    text = json.dumps(rehashed(header, arrays)).encode()
    file = io.BytesIO()
    np.savez(file, header=np.frombuffer(text, np.uint8), **arrays)
    return file.getvalue()


def _change(header: dict[str, Any], arrays: dict[str, Any], words: list[str]) -> None:
    name, what, place, number = words[0], words[1], int(words[2]), float(words[3])
    if name == "header":
        *path, last = what.split(".")
        for key in path:
            header = header[key]
        header[last] = number if place % 2 else int(number)
        return
    array = arrays[name]
    if what == "scale":
        arrays[name] = (array * number).astype(array.dtype)
    elif what == "put":
        array.reshape(-1)[place % max(array.size, 1)] = number
    elif what == "noise":
        arrays[name] = (number * np.random.default_rng(abs(place)).normal(size=array.shape)).astype(array.dtype)
    elif what == "turn":
        arrays[name] = np.ascontiguousarray(array.T)
    elif what == "drop":
        arrays[name] = array[: place % (len(array) + 1)]
    elif what == "type":
        arrays[name] = array.astype("<f4" if place % 2 else "<i8")


def identify_from(path: Path, robot: Robot) -> None:
    """Identify from a file of factors; results are finite."""
    found = signid.identify(robot, signid.load_factors(path, robot))
    assert np.isfinite(found.base_value).all(), "base parameters that are not finite"


def rehashed(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The header with the hash of the arrays."""
    return {**header, "sha256": hash_of(arrays)}
