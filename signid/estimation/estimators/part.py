"""Samples on a uniform grid -> part of a session, in memory."""

from __future__ import annotations

import numpy as np

from ...recording import read_recording
from ...recording.sampling import survey
from ...regression.session import Part, Session
from ...types import Samples


def part_of(session: Session, piece: Samples) -> Part:
    """Recording of the session's joints with the given samples, without recorded derivatives.

    Args:
        session: session with the robot.
        piece: uniform samples without gaps.
    """
    robot = session.robot
    known = np.asarray(~np.isnan(piece.tau).all(axis=0))
    columns = {"t": piece.t}
    for j, number in enumerate(robot.numbers):
        columns[f"q_{number}"] = piece.q[:, j]
        if known[j]:
            columns[f"tau_{number}"] = piece.tau[:, j]
        if piece.q_des is not None:
            columns[f"q_des_{number}"] = piece.q_des[:, j]
    recording = read_recording(columns, robot)
    return recording, survey(recording, robot)
