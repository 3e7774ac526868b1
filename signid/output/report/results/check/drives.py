"""Audit of recordings of position drives: description, JSON document, terminal text and page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from .....types import TWO_SIDED, Input
from ...documents import Document, ending, once, stamps_clock
from ...layout import figure, plural, share
from ...sections import Cells
from .page import recorded_plots, recording_files, summary_page
from .summary import (
    FAULTY,
    GOOD,
    LIMITED,
    UNUSABLE,
    CheckSummary,
    FaultWords,
    GravityUse,
    Identifiable,
    first_part,
    joint_words,
    recording_names,
    summary_document,
    summary_tables,
    unit_notes,
    unit_uses,
)

if TYPE_CHECKING:
    from .....faults import JointAudit, ServoAudit

LEGEND = (
    "range: of the command; error: rms of command - position; lag: delay of a slow ramp beside that of dry friction; "
    "71 % at: frequency at which the motion is 71 % of the command; hysteresis: half width, dry friction or dead band; "
    "droop: error at rest; at limit: share of rows"
)
SEARCHED = (
    *("wrong sign", "copied, early, late or noisy commands", "positions that do not follow", "wrong unit or scale"),
    *("different zeros", "wrapped, stuck, repeated or coarse positions", "spikes", "uneven stamps"),
)
OWN = 0.75  # [1] share of the rate below which rows have no content of their own: every second one at most
FEW_HOLDS = 2  # times at rest of a joint, below which more are advised: droop is their median


def audit_summary(found: ServoAudit, robot: str = "") -> CheckSummary:
    """Describe the audit of recordings of position drives; `robot`: its name, "" without a description."""
    given = f"{plural(len(found.recordings), 'recording')} of {plural(len(found.joints), 'servo joint')}"
    faults = tuple(FaultWords("", _about(found, flag), flag) for flag in found.flags if flag not in found.limits)
    positions = {joint: "rad" for recording in found.recordings for joint in recording.joints}
    positions |= {joint.joint: joint.unit for joint in found.joints}
    which, units = _identifiable(found), unit_notes(found.notes)
    verdict, headline = _headline(found, faults, which)
    return CheckSummary(
        title=f"{robot}: {given}" if robot else given,
        verdict=verdict,
        headline=headline,
        sampling=_sampling(found),
        sampled=tuple(_sampled(found)),
        units=unit_uses(found.recordings, positions),
        unit_notes=units,
        gravity=GravityUse("not judged", "not judged: commands and positions without torque do not show it"),
        faults=faults,
        clear=() if faults else SEARCHED,
        joints=_joints(found),
        legend=LEGEND,
        identifiable=which,
        excitation="",
        advice=tuple(_advice(found, which)),
        notes=tuple(note for note in found.notes if note not in units and "no torque" not in note),
    )


def audit_document(found: ServoAudit, inputs: Sequence[Input] = (), seed: int = 0, robot: str = "") -> Document:
    """Build the output of `signid check --json` for servo recordings; `robot`: its name, "" without a description."""
    columns = (found.rates, found.content_rates, found.durations, found.uneven, found.breaks, found.commanded)
    return {
        "schema": "signid.check/1",
        "robot": robot or None,
        **summary_document(audit_summary(found, robot)),
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
        **ending(found, recording_files(found.recordings), inputs, seed),
    }


def audit_tables(found: ServoAudit, robot: str = "") -> list[RenderableType]:
    """Sampling, units, faults, joints and what is identifiable, on one screen; `robot`: its name, or ""."""
    return summary_tables(audit_summary(found, robot))


def audit_page(
    found: ServoAudit, inputs: Sequence[Input] = (), command: str = "", seed: int = 0, robot: str = ""
) -> str:
    """Render report.html of an audit of position drives; `robot`: its name, "" without a description."""
    summary = audit_summary(found, robot)
    joints = [one.joint for one in found.joints]
    half = {"half the content rate": min(found.content_rates) / 2}
    known = (one.bandwidth if verdict_of(one) == "identifiable" else np.nan for one in found.joints)
    marks = [{"71 % of the command": bandwidth, **half} for bandwidth in known]
    units = [(one.unit or "no unit", "") for one in found.joints]
    return summary_page(
        summary,
        list(recorded_plots(found.recordings, found.stretches, joints, units, marks, summary)),
        Cells(["drive", "lag and bandwidth"], [(one.joint, verdict_of(one)) for one in found.joints]),
        once([*recording_files(found.recordings), *inputs]),
        command=command,
        seed=seed,
    )


def _about(found: ServoAudit, flag: str) -> tuple[str, ...]:
    """Joints that a fault is about."""
    return tuple(one.joint for one in found.joints if any(flag.endswith(x.removeprefix(one.joint)) for x in one.flags))


def _headline(found: ServoAudit, faults: Sequence[FaultWords], which: Identifiable) -> tuple[str, str]:
    """Verdict, and a sentence on it with the worst fault or lack."""
    more = f"; {plural(len(faults) - 1, 'more fault')} below" if len(faults) > 1 else ""
    if not which.total:
        return UNUSABLE, f"Not usable for identification of drives: {faults[0].fact}{more}"
    if faults:
        return FAULTY, f"Usable once this is corrected: {faults[0].worst}{more}"
    said = f"the lag of {len(which.identifiable)} of {plural(which.total, which.noun)} is identifiable"
    worst = max(found.joints, key=lambda one: one.error / one.range if one.range else 0.0)
    size = f"{worst.joint}: {figure(worst.error, 2)} {worst.unit}".rstrip()
    error = f"tracking errors up to {share(worst.error / worst.range) if worst.range else '-'} of the range ({size})"
    if found.limits:
        return LIMITED, f"Limited: {first_part(found.limits[0])}; {said}"
    if not which.identifiable:
        return LIMITED, f"Limited: {said}; {error}"
    return GOOD, f"Good for identification of drives: no fault found, {said}; {error}"


def verdict_of(joint: JointAudit) -> str:
    """Whether the lag of a drive is identifiable; weak where the motion does not separate it from dry friction."""
    if TWO_SIDED * joint.lag_std < joint.lag:
        return "identifiable"
    return "weak" if joint.shift == joint.shift else "unidentifiable"


def _identifiable(found: ServoAudit) -> Identifiable:
    verdicts = [(one.joint, verdict_of(one)) for one in found.joints]
    names = (
        tuple(joint for joint, verdict in verdicts if verdict == kind)
        for kind in ("identifiable", "weak", "unidentifiable")
    )
    return Identifiable("drive", *names)


def _advice(found: ServoAudit, which: Identifiable) -> Iterator[str]:
    if not which.total:
        return
    yield from found.limits
    if which.weak:
        yield (
            f"lag and dry friction of {joint_words(which.weak, which.total)} are not separated by this motion: add "
            "faster motion, ramps of several speeds or steps"
        )
    if which.unidentifiable:
        yield f"{joint_words(which.unidentifiable, which.total)}: no response to a command: record one"
    still = [one.joint for one in found.joints if one.holds < FEW_HOLDS]
    if still:
        yield f"no rest shows the droop of {joint_words(still, which.total)}: hold some positions for a second or more"
    yield "signid identify gives kp, damping, delay and friction; their scale needs known masses or a gain (--known)"


def _sampling(found: ServoAudit) -> Cells:
    heads = "recording", "rows>", "used>", "seconds>", "rate\n[Hz]>", "content\n[Hz]>", "clock", "breaks>"
    columns = (found.commanded, found.durations, found.rates, found.content_rates, found.uneven, found.breaks)
    names, rows = recording_names(found.recordings), []
    for name, recording, commanded, seconds, rate, content, uneven, breaks in zip(
        names, found.recordings, *columns, strict=True
    ):
        used, clock = share(commanded / max(len(recording), 1)), f"stamps, {share(uneven) if uneven else 'even'}"
        rates = figure(rate, 4), figure(min(content, rate), 4)
        clock += " uneven" if uneven else ""
        rows.append((name, str(len(recording)), used, figure(seconds), *rates, clock, str(breaks)))
    return Cells(heads, tuple(rows))


def _sampled(found: ServoAudit) -> Iterator[str]:
    """Recordings whose rows are not all of their own."""
    names = recording_names(found.recordings)
    for name, rate, content in zip(names, found.rates, found.content_rates, strict=True):
        if content < OWN * rate:
            yield f"{name}: positions are interpolated or repeated from about {content:.4g} Hz"


def _joints(found: ServoAudit) -> Cells:
    unit = " or ".join(dict.fromkeys(one.unit for one in found.joints if one.unit))
    heads = (
        *("joint", f"range\n[{unit}]>" if unit else "range>", f"speed\n[{unit or '1'}/s]>", "step>", "error>"),
        *("lag\n[ms]>", "71 % at\n[Hz]>", "hysteresis>", "droop>", "scale>", "at\nlimit>"),
    )
    return Cells(heads, tuple(map(_cells, found.joints)))


def _cells(joint: JointAudit) -> tuple[str, ...]:
    wide, known = TWO_SIDED * joint.lag_std, verdict_of(joint) == "identifiable"
    lag = f"{1e3 * joint.lag:.0f} ± {1e3 * wide:.0f}" if known else "-"
    return (
        joint.joint,
        figure(joint.range),
        *(figure(x, 2) for x in (joint.speed, joint.quantum, joint.error)),
        lag,
        figure(joint.bandwidth, 2) if known else "-",
        *(figure(x, 2) for x in (joint.width, joint.droop, joint.scale)),
        share(joint.saturated),
    )
