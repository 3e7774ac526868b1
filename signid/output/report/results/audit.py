"""Audit of servo recordings: JSON document and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType

from ....types import TWO_SIDED, Input
from ..layout import figure, heading, new_table, note_lines, paragraph, plural, share
from .documents import Document, ending

if TYPE_CHECKING:
    from ....servo.audit import JointAudit, ServoAudit

BRIEF = (
    "lag: delay of a slow ramp beside that of dry friction (- where the motion does not separate them); shift: best "
    "shift of the command; 71 % at: frequency at which the motion is 71 % of the command; hysteresis: half width, dry "
    "friction or dead band; droop: error at rest; held: moving rows that repeat the position before."
)


def audit_document(found: ServoAudit, inputs: Sequence[Input] = (), seed: int = 0, robot: str = "") -> Document:
    """Build the output of `signid check --json` for servo recordings; `robot`: its name, "" without a description."""
    read = [Input(recording.path, recording.sha256, "recording") for recording in found.recordings]
    return {
        "schema": "signid.check/1",
        "robot": robot or None,
        "recordings": [
            {"path": recording.path, "rate": rate, "duration": duration, "samples": len(recording), "uneven": uneven}
            for recording, rate, duration, uneven in zip(
                found.recordings, found.rates, found.durations, found.uneven, strict=True
            )
        ],
        "servo": [{**joint.numbers(), "flags": list(joint.flags)} for joint in found.joints],
        **ending(found, read, inputs, seed),
    }


def audit_tables(found: ServoAudit, robot: str = "") -> list[RenderableType]:
    """Recordings, and one line a joint."""
    given = f"{plural(len(found.recordings), 'recording')} of {plural(len(found.joints), 'servo joint')}"
    recordings = new_table("recording", "rate [Hz]>", "commanded [s]>", "samples>", "uneven steps>")
    rows = zip(found.recordings, found.rates, found.durations, found.uneven, strict=True)
    for recording, rate, duration, uneven in rows:
        name = Path(recording.path).name or "(arrays)"
        recordings.add_row(name, figure(rate, 4), figure(duration), str(len(recording)), share(uneven))
    joints = new_table(
        *("joint", "lag [ms]>", "shift [ms]>", "71 % at [Hz]>", "hysteresis>", "droop>", "unit", "scale>", "at limit>"),
        "held>",
    )
    for joint in found.joints:
        joints.add_row(*_cells(joint))
    return [
        heading(f"{robot}: {given}" if robot else given, below=False),
        recordings,
        heading("How the joints follow their commands"),
        joints,
        paragraph(BRIEF),
        *note_lines(found.notes),
    ]


def _cells(joint: JointAudit) -> tuple[str, ...]:
    """One line a joint."""
    lengths = (figure(x, 2) for x in (joint.width, joint.droop))
    shares = (share(x) if x == x else "-" for x in (joint.saturated, joint.held))
    wide = TWO_SIDED * joint.lag_std
    lag = f"{1e3 * joint.lag:.0f} ± {1e3 * wide:.0f}" if wide < joint.lag else "-"
    band = figure(joint.bandwidth, 2) if wide < joint.lag else "-"
    unit = joint.unit or "not stated"
    return joint.joint, lag, figure(1e3 * joint.shift, 3), band, *lengths, unit, figure(joint.scale, 2), *shares
