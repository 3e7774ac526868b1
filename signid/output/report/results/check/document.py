"""Check -> JSON document of `signid check --json` and check.json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .....types import Input
from ...documents import Document, description, ending, excitation_verdict, picked, recorded, stamps_clock
from ..identification import base_documents
from .drives import audit_summary, verdict_of
from .summary import CheckSummary
from .torque import check_summary, motion_sizes

if TYPE_CHECKING:
    from .....check import Check
    from .....faults import RecordingFaults, ServoAudit


def check_document(found: Check, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build check.json of recordings with torque; `inputs` defaults to the robot description."""
    robot, band = found.robot, found.band
    read = [Input(recording.path, recording.sha256, "recording") for recording in found.recordings]
    sizes = (band.per_joint, found.used, band.torque_floor, *motion_sizes(found), found.faults.weight)
    names = ("cutoff", "used", "noise_floor", "range", "speed", "torque_rms", "weight")
    joints = zip(robot.joints, *(map(float, size) for size in sizes), strict=True)
    verdicts = zip(base_documents(found.base), found.std, found.verdicts, strict=True)
    return {
        "schema": "signid.check/1",
        "robot": robot.name,
        **_shared(check_summary(found)),
        "joints": [dict(zip(("name", *names), joint, strict=True)) for joint in joints],
        "recordings": [
            {**recorded(recording, s), "rate": 1 / s.step, "duration": s.duration, "samples": s.rows}
            | {**picked(s, "spans duplicates uniform"), "spacing": list(s.jitter)}
            | {"rows": len(recording), "breaks": len(s.spans) - 1}
            for recording, s in zip(found.recordings, found.samplings, strict=True)
        ],
        "cutoff": {"torque": band.cutoff, "position": band.position_cutoff, "unit": "Hz"},
        "base_parameters": [{**base, "std": float(std), "verdict": verdict} for base, std, verdict in verdicts],
        "excitation": excitation_verdict(found.excitation),
        "recording_faults": _faults_document(found.faults),
        "advice": list(found.advice),
        **ending(found, read, inputs or [description(robot)], seed),
    }


def _shared(summary: CheckSummary) -> Document:
    """Entries that a check has in both modes."""
    which = summary.identifiable
    return {
        "verdict": summary.verdict,
        "headline": summary.headline,
        "units": [
            {"signal": use.signal, "columns": list(use.columns), "stated": use.unit or None, "by": use.by or None}
            | {"unit": use.into or None, "torque_constants": list(use.factors) or None}
            for use in summary.units
        ],
        "gravity": summary.gravity._asdict(),
        "faults": [
            {"kind": fault.kind or None, "joints": list(fault.joints), "sentence": fault.sentence}
            for fault in summary.faults
        ],
        "looked_for": list(summary.clear),
        "identifiable": {
            "of": which.total,
            **{key: list(getattr(which, key)) for key in ("identifiable", "weak", "unidentifiable")},
        },
    }


def audit_document(found: ServoAudit, inputs: Sequence[Input] = (), seed: int = 0, robot: str = "") -> Document:
    """Build the output of `signid check --json` for servo recordings; `robot`: its name, "" without a description."""
    read = [Input(recording.path, recording.sha256, "recording") for recording in found.recordings]
    columns = (found.rates, found.content_rates, found.durations, found.uneven, found.breaks, found.commanded)
    return {
        "schema": "signid.check/1",
        "robot": robot or None,
        **_shared(audit_summary(found, robot)),
        "recordings": [
            {
                "path": recording.path,
                "rate": rate,
                "clock": stamps_clock(1 / rate),
                "content_rate": content,
                "duration": duration,
                "samples": len(recording),
                "uneven": uneven,
                "breaks": breaks,
                "commanded": commanded,
            }
            for recording, rate, content, duration, uneven, breaks, commanded in zip(
                found.recordings, *columns, strict=True
            )
        ],
        "servo": [
            {**joint.numbers(), "verdict": verdict_of(joint), "flags": list(joint.flags)} for joint in found.joints
        ],
        **ending(found, read, inputs, seed),
    }


def _faults_document(found: RecordingFaults) -> Document:
    sizes = (map(float, column) for column in (found.explained, found.factor, found.lag))
    joints = zip(found.joints, *sizes, found.signs, found.order, strict=True)
    keys = ("name", "explained", "factor", "lag", "sign", "order")
    return {
        "joints": [dict(zip(keys, joint, strict=True)) for joint in joints],
        "findings": [
            {
                **picked(finding, "kind joints severity measures sentence"),
                "alternatives": [{"kind": kind, "joints": list(joints)} for kind, joints in finding.alternatives],
            }
            for finding in found.findings
        ],
    }
