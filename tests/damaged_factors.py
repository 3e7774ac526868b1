"""A file of factors of the robot 1r, and the same with another header."""

from __future__ import annotations

import io
from functools import cache

import numpy as np

import signid
from signid.recording import read_recording
from signid.types import Robot


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
