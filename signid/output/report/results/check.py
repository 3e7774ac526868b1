"""Checks of recordings with torque, and audits of position drives: description, JSON document, text and page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from ....estimation.excitation import MIN_INFO
from ....faults import OF_A_FIT
from ....faults.gravity import WHOLE
from ....types import TWO_SIDED, Array, Input
from ..documents import Document, description, ending, excitation_verdict, once, picked, recorded, stamps_clock
from ..layout import figure, plural, position_units, share, torque_units
from ..sections import Cells
from .check_page import recorded_plots, recording_files, summary_page, used_times
from .check_summary import (
    FAULTY,
    GOOD,
    LIMITED,
    SAMPLING_HEADS,
    UNUSABLE,
    CheckSummary,
    FaultWords,
    GravityUse,
    Identifiable,
    first_part,
    identifiable_of,
    joint_words,
    recording_names,
    summary_document,
    summary_tables,
    unit_notes,
    unit_uses,
)
from .identification import base_documents, cutoff_words, excited_words

if TYPE_CHECKING:
    from ....check import Check
    from ....faults import JointAudit, ServoAudit

DRIVE_LEGEND = (
    "range: of the command; error: rms of command - position; lag: delay of a slow ramp beside that of dry friction; "
    "71 % at: frequency at which the motion is 71 % of the command; hysteresis: half width, dry friction or dead band; "
    "droop: error at rest; at limit: share of rows"
)
SEARCHED_FAULTS = (
    *("wrong sign", "copied, early, late or noisy commands", "positions that do not follow", "wrong unit or scale"),
    *("different zeros", "wrapped, stuck, repeated or coarse positions", "spikes", "uneven stamps"),
)
MIN_CONTENT_SHARE = 0.75  # [1] of the rate, below which at most every second row has content
ENOUGH_HOLDS = 2  # times at rest of a joint, below which more are advised: droop is their median
MIN_IDENTIFIABLE_SHARE = 0.5  # [1] share of identifiable base parameters, below which recordings are limited
SAMPLE_FAULTS = {  # what is looked for in the samples, and the kinds of its faults
    "rows out of order or without motion": ("order of rows", "standstill"),
    "drop-outs or spikes": ("drop-outs", "spikes"),
    "stuck or coarse positions": ("stuck position", "skipping position", "coarse position"),
    "clipped or stuck torque": ("clipping", "stuck torque", "few torque values"),
    "exceeded limits": ("torque limit", "velocity limit", "position limit"),
}
TORQUE_FAULTS = {  # what is looked for by comparison of signed torque with the description
    "wrong sign": ("torque sign", "position sign", "axis"),
    "exchanged joints": ("torque order", "position order", "joint order"),
    "wrong unit, scale or gain": ("degrees", "revolutions", "millimetres", "units", "gain", "position scale"),
    "shifted zero": ("position zero",),
    "late or early torque": ("lag", "long lag"),
    "wrong clock": ("clock", "reversed torque", "reversed positions", "reversed time"),
    "lost sign": ("absolute torque", "square root", "square"),
    "other gravity": ("gravity", "weight"),
    "unexplained torque": ("unexplained torque",),
}
DESCRIPTION_FAULTS = {"wrong axis": "joint axis", "held joints elsewhere": "held joints"}  # where torque is unexplained


def check_summary(found: Check) -> CheckSummary:
    """Describe the check of recordings with torque."""
    robot, which = found.robot, identifiable_of("base parameter", found.base.expressions, found.verdicts)
    named = {f.sentence: FaultWords(f.kind, f.joints, f.sentence) for f in found.faults.findings}
    flags = dict.fromkeys((*found.suspects, *found.faults.flags, *found.flags))  # the most severe first
    faults = tuple(named.get(flag, FaultWords("", (), flag)) for flag in flags if flag not in _of_a_fit(found))
    files = f"{plural(len(found.recordings), 'recording')} of {plural(len(robot.joints), 'joint')}"
    verdict, headline = _headline(found, faults, which)
    sampled = tuple(dict.fromkeys(note for sampling in found.samplings for note in sampling.notes))
    units = unit_notes([note for recording in found.recordings for note in recording.notes])
    tried = {words: (kind,) for words, kind in DESCRIPTION_FAULTS.items() if kind in found.faults.tried}
    looked_for = SAMPLE_FAULTS | (TORQUE_FAULTS if found.faults.compared else {}) | tried
    seen = {fault.kind for fault in found.faults.findings}
    rows = []
    for name, recording, s in zip(recording_names(found.recordings), found.recordings, found.samplings, strict=True):
        used = share(min(s.rows / max(len(recording), 1), 1.0))
        rates = figure(1 / s.step, 4), figure(s.content_rate, 4)
        shortest, longest = (figure(1e3 * x) for x in s.jitter)
        clock = "stamps, even" if s.uniform or shortest == longest else f"stamps, {shortest} to {longest} ms"
        if s.clock.kind != "stamps":
            lost = f", {s.clock.missing} rows lost" if s.clock.missing else ""
            clock = f"{s.clock.kind}, jitter {figure(1e3 * s.clock.jitter, 2)} ms{lost}"
        rows.append((name, str(len(recording)), used, figure(s.duration), *rates, clock, str(len(s.spans) - 1)))
    return CheckSummary(
        title=f"{robot.name}: {files}",
        verdict=verdict,
        headline=headline,
        sampling=Cells(SAMPLING_HEADS, tuple(rows)),
        sampled=sampled,
        units=unit_uses(found.recordings, dict(zip(robot.joints, position_units(robot), strict=True))),
        unit_notes=units,
        gravity=gravity_use(found),
        faults=faults,
        clear=tuple(words for words, kinds in looked_for.items() if not seen.intersection(kinds)),
        joints=_joint_table(found),
        legend=f"{cutoff_words(found.band.cutoff, found.band.position_cutoff)}; explained: share of the torque that "
        "the description with any friction and rotor explains",
        identifiable=which,
        excitation=excited_words(found.excitation),
        advice=tuple(dict.fromkeys((*_of_a_fit(found), *found.advice))),
        notes=tuple(note for note in found.notes if not any(note.endswith(said) for said in (*sampled, *units))),
    )


def check_document(checked: Check, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build check.json of recordings with torque; `inputs` defaults to the robot description."""
    robot, band, faults = checked.robot, checked.band, checked.faults
    fault_names = ("explained", "factor", "lag", "sign", "order")
    measures = (map(float, column) for column in (faults.explained, faults.factor, faults.lag))
    fault_rows = zip(faults.joints, *measures, faults.signs, faults.order, strict=True)
    sizes = (band.per_joint, checked.used, band.torque_floor, *motion_sizes(checked), faults.weight)
    names = ("cutoff", "used", "noise_floor", "range", "speed", "torque_rms", "weight")
    joints = zip(robot.joints, *(map(float, size) for size in sizes), strict=True)
    verdicts = zip(base_documents(checked.base), checked.std, checked.verdicts, strict=True)
    return {
        "schema": "signid.check/1",
        "robot": robot.name,
        **summary_document(check_summary(checked)),
        "joints": [dict(zip(("name", *names), joint, strict=True)) for joint in joints],
        "recordings": [
            {**recorded(recording, s), "rate": 1 / s.step, "duration": s.duration, "samples": s.rows}
            | {**picked(s, "spans duplicates uniform"), "spacing": list(s.jitter)}
            | {"rows": len(recording), "breaks": len(s.spans) - 1}
            for recording, s in zip(checked.recordings, checked.samplings, strict=True)
        ],
        "cutoff": {"torque": band.cutoff, "position": band.position_cutoff, "unit": "Hz"},
        "base_parameters": [{**base, "std": float(std), "verdict": verdict} for base, std, verdict in verdicts],
        "excitation": excitation_verdict(checked.excitation),
        "recording_faults": {
            "joints": [dict(zip(("name", *fault_names), joint, strict=True)) for joint in fault_rows],
            "findings": [
                {
                    **picked(finding, "kind joints severity measures sentence"),
                    "alternatives": [{"kind": kind, "joints": list(joints)} for kind, joints in finding.alternatives],
                }
                for finding in faults.findings
            ],
        },
        "advice": list(checked.advice),
        **ending(checked, recording_files(checked.recordings), inputs or [description(robot)], seed),
    }


def check_tables(checked: Check) -> list[RenderableType]:
    """Sampling, units, gravity, faults, joints and what is identifiable, on one screen."""
    return summary_tables(check_summary(checked))


def check_page(checked: Check, inputs: Sequence[Input] = (), command: str = "", seed: int = 0) -> str:
    """Render report.html of a check; `inputs` besides the recordings default to the description."""
    robot, band = checked.robot, checked.band
    base = zip(checked.base.expressions, checked.std, checked.base.units, checked.verdicts, strict=True)
    used = [used_times(recording, s.spans) for recording, s in zip(checked.recordings, checked.samplings, strict=True)]
    half = {"half the content rate": min(s.content_rate for s in checked.samplings) / 2}
    limits = band.per_joint.tolist()
    marks = [{"cut-off": band.cutoff, "highest for its noise": limit, **half} for limit in limits]
    units = list(zip(position_units(robot), torque_units(robot), strict=True))
    return summary_page(
        check_summary(checked),
        list(recorded_plots(checked.recordings, used, robot.joints, units, marks, check_summary(checked))),
        Cells(
            ["base parameter", "± 95 %>", "unit", "verdict"],
            [(name, figure(TWO_SIDED * std, 2), unit, verdict) for name, std, unit, verdict in base],
        ),
        once([*recording_files(checked.recordings), *(inputs or [description(robot)])]),
        command=command,
        seed=seed,
    )


def _headline(checked: Check, faults: Sequence[FaultWords], which: Identifiable) -> tuple[str, str]:
    """Verdict, and a sentence on it with the worst fault or lack."""
    if refusal := checked.faults.refusal:
        more = sum(fault.sentence != refusal for fault in faults)
        return UNUSABLE, f"Not usable for identification: {first_part(refusal)}{_more(more)}"
    if faults:
        return FAULTY, f"Usable once this is corrected: {faults[0].worst}{_more(len(faults) - 1)}"
    left = f"{len(which.identifiable)} of {plural(which.total, which.noun)} identifiable"
    left += f", {len(which.unidentifiable)} not" if which.unidentifiable else ""
    if not checked.excitation.sufficient:
        weakest = f"{max(float(checked.excitation.shares[0]), 0.0):.2%} of the information of a random motion"
        return LIMITED, f"Too little excitation: the weakest direction has {weakest} ({share(MIN_INFO)} needed); {left}"
    if len(which.identifiable) < MIN_IDENTIFIABLE_SHARE * which.total:
        part = f"only {len(which.identifiable)} of {plural(which.total, which.noun)} identifiable"
        others = f"{len(which.weak)} weakly, {len(which.unidentifiable)} not within the uncertainty of the torque"
        return LIMITED, f"Limited: {part}, {others}"
    return GOOD, f"Good for identification: no fault found, {left}{''.join(f'; {x}' for x in checked.advice[:1])}"


def _more(faults: int) -> str:
    return f"; {plural(faults, 'more fault')} below" if faults > 0 else ""


def _of_a_fit(checked: Check) -> tuple[str, ...]:
    """Flags that are no faults of the log, but lacks of its motion."""
    return (*checked.excitation.sentences, *(f.sentence for f in checked.faults.findings if f.kind in OF_A_FIT))


def gravity_use(checked: Check) -> GravityUse:
    """Compare the stated gravity with the weight in the torque."""
    from ....robot.joints import gravity_text, root_link

    if other := next((fault for fault in checked.faults.findings if fault.kind == "gravity"), None):
        return GravityUse("differs", first_part(other.sentence))
    stated = np.asarray(checked.robot.model.gravity.linear)
    text = f"{gravity_text(stated)} m/s2 in the frame of {root_link(checked.robot)}"
    if not checked.faults.compared:
        return GravityUse("not judged", f"stated {text}; not judged: no signed torque could be compared with it")
    if not stated.any():
        return GravityUse("agrees", "stated as zero, and no direction explains the torque better")
    weight = checked.faults.weight
    known = np.flatnonzero(np.isfinite(weight))
    if not len(known):
        return GravityUse("not judged", f"stated {text}; not judged: the weight hardly shows in any torque")
    low, high = (float(x) for x in (weight[known].min(), weight[known].max()))
    carried = " to ".join(dict.fromkeys(f"{100 * x:.0f}" for x in (low, high))) + " %"
    where = joint_words([checked.faults.joints[j] for j in known], len(checked.faults.joints))
    if WHOLE[0] <= low and high <= WHOLE[1]:
        return GravityUse("agrees", f"agrees with {text}: {carried} of the stated weight shows in {where}")
    return GravityUse("uncertain", f"stated {text}; the torque of {where} carries {carried} of this weight")


def _joint_table(checked: Check) -> Cells:
    robot, band, faults = checked.robot, checked.band, checked.faults
    length, torque = (" or ".join(dict.fromkeys(unit(robot))) for unit in (position_units, torque_units))
    heads = (
        *("joint", f"range\n[{length}]>", f"speed\n[{length}/s]>", f"torque\n[{torque}]>", f"noise\n[{torque}]>"),
        *("cut-off\n[Hz]>", "rows\nused>", "explained>", "factor>", "sign"),
    )
    ranges, speed, rms = motion_sizes(checked)
    columns = (robot.joints, ranges, speed, rms, band.torque_floor, band.per_joint, checked.used)
    verdicts = (faults.explained, faults.factor, faults.signs)
    rows = (
        (joint, figure(x), figure(v, 2), figure(t), figure(noise, 2), figure(f), share(used), share(r), figure(k, 2), s)
        for joint, x, v, t, noise, f, used, r, k, s in zip(*columns, *verdicts, strict=True)
    )
    return Cells(heads, tuple(rows))


def motion_sizes(checked: Check) -> tuple[Array, Array, Array]:
    """Range of the positions, rms velocity and rms torque of each joint over all recordings, (n,) each [SI units]."""
    rows = np.array([s.rows for s in checked.samplings], dtype=float)
    lower, upper = (np.array([getattr(s, key) for s in checked.samplings]) for key in ("lower", "upper"))

    def mean(key: str) -> Array:
        values = np.array([getattr(s, key) for s in checked.samplings])
        return np.asarray(np.sqrt(np.average(values**2, axis=0, weights=rows)))

    return upper.max(axis=0) - lower.min(axis=0), mean("speed"), mean("torque_rms")


def audit_summary(audit: ServoAudit, robot: str = "") -> CheckSummary:
    """Describe the audit of recordings of position drives; `robot`: its name, "" without a description."""
    files = f"{plural(len(audit.recordings), 'recording')} of {plural(len(audit.joints), 'servo joint')}"
    ends = {x.joint: tuple(flag.removeprefix(x.joint) for flag in x.flags) for x in audit.joints}
    faults = tuple(
        FaultWords("", tuple(joint for joint, end in ends.items() if flag.endswith(end)), flag)
        for flag in audit.flags
        if flag not in audit.limits
    )
    positions = {joint: "rad" for recording in audit.recordings for joint in recording.joints}
    positions |= {joint.joint: joint.unit for joint in audit.joints}
    which = identifiable_of("drive", [x.joint for x in audit.joints], map(verdict_of, audit.joints))
    units = unit_notes(audit.notes)
    verdict, headline = _drive_headline(audit, faults, which)
    columns = (audit.commanded, audit.durations, audit.rates, audit.content_rates, audit.uneven, audit.breaks)
    names, rows = recording_names(audit.recordings), []
    for name, recording, commanded, seconds, rate, content, uneven, breaks in zip(
        names, audit.recordings, *columns, strict=True
    ):
        used, clock = share(commanded / max(len(recording), 1)), f"stamps, {share(uneven) if uneven else 'even'}"
        rates = figure(rate, 4), figure(min(content, rate), 4)
        clock += " uneven" if uneven else ""
        rows.append((name, str(len(recording)), used, figure(seconds), *rates, clock, str(breaks)))
    return CheckSummary(
        title=f"{robot}: {files}" if robot else files,
        verdict=verdict,
        headline=headline,
        sampling=Cells(SAMPLING_HEADS, tuple(rows)),
        sampled=tuple(
            f"{name}: positions are interpolated or repeated from about {content:.4g} Hz"
            for name, rate, content in zip(
                recording_names(audit.recordings), audit.rates, audit.content_rates, strict=True
            )
            if content < MIN_CONTENT_SHARE * rate
        ),
        units=unit_uses(audit.recordings, positions),
        unit_notes=units,
        gravity=GravityUse("not judged", "not judged: commands and positions without torque do not show it"),
        faults=faults,
        clear=() if faults else SEARCHED_FAULTS,
        joints=_drive_table(audit),
        legend=DRIVE_LEGEND,
        identifiable=which,
        advice=tuple(_drive_advice(audit, which)),
        notes=tuple(note for note in audit.notes if note not in units and "no torque" not in note),
    )


def audit_document(audit: ServoAudit, inputs: Sequence[Input] = (), seed: int = 0, robot: str = "") -> Document:
    """Build the output of `signid check --json` for servo recordings; `robot`: its name, "" without a description."""
    columns = (audit.rates, audit.content_rates, audit.durations, audit.uneven, audit.breaks, audit.commanded)
    return {
        "schema": "signid.check/1",
        "robot": robot or None,
        **summary_document(audit_summary(audit, robot)),
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
                audit.recordings, *columns, strict=True
            )
        ],
        "servo": [
            {**joint.numbers(), "verdict": verdict_of(joint), "flags": list(joint.flags)} for joint in audit.joints
        ],
        **ending(audit, recording_files(audit.recordings), inputs, seed),
    }


def audit_tables(audit: ServoAudit, robot: str = "") -> list[RenderableType]:
    """Sampling, units, faults, joints and what is identifiable, on one screen; `robot`: its name, or ""."""
    return summary_tables(audit_summary(audit, robot))


def audit_page(
    audit: ServoAudit, inputs: Sequence[Input] = (), command: str = "", seed: int = 0, robot: str = ""
) -> str:
    """Render report.html of an audit of position drives; `robot`: its name, "" without a description."""
    summary = audit_summary(audit, robot)
    joints, verdicts = [x.joint for x in audit.joints], list(map(verdict_of, audit.joints))
    half = {"half the content rate": min(audit.content_rates) / 2}
    bandwidths = [
        x.bandwidth if verdict == "identifiable" else np.nan for x, verdict in zip(audit.joints, verdicts, strict=True)
    ]
    marks = [{"71 % of the command": bandwidth, **half} for bandwidth in bandwidths]
    units = [(x.unit or "no unit", "") for x in audit.joints]
    return summary_page(
        summary,
        list(recorded_plots(audit.recordings, audit.stretches, joints, units, marks, summary)),
        Cells(["drive", "lag and bandwidth"], list(zip(joints, verdicts, strict=True))),
        once([*recording_files(audit.recordings), *inputs]),
        command=command,
        seed=seed,
    )


def _drive_headline(audit: ServoAudit, faults: Sequence[FaultWords], which: Identifiable) -> tuple[str, str]:
    """Verdict, and a sentence on it with the worst fault or lack."""
    more = _more(len(faults) - 1)
    if not which.total:
        return UNUSABLE, f"Not usable for identification of drives: {faults[0].fact}{more}"
    if faults:
        return FAULTY, f"Usable once this is corrected: {faults[0].worst}{more}"
    said = f"the lag of {len(which.identifiable)} of {plural(which.total, which.noun)} is identifiable"
    worst = max(audit.joints, key=lambda joint: joint.error / joint.range if joint.range else 0.0)
    size = f"{worst.joint}: {figure(worst.error, 2)} {worst.unit}".rstrip()
    error = f"tracking errors up to {share(worst.error / worst.range) if worst.range else '-'} of the range ({size})"
    if audit.limits:
        return LIMITED, f"Limited: {first_part(audit.limits[0])}; {said}"
    if not which.identifiable:
        return LIMITED, f"Limited: {said}; {error}"
    return GOOD, f"Good for identification of drives: no fault found, {said}; {error}"


def verdict_of(joint: JointAudit) -> str:
    """Whether the lag of a drive is identifiable; weak where the motion does not separate it from dry friction."""
    if TWO_SIDED * joint.lag_std < joint.lag:
        return "identifiable"
    return "weak" if joint.shift == joint.shift else "unidentifiable"


def _drive_advice(audit: ServoAudit, which: Identifiable) -> Iterator[str]:
    if not which.total:
        return
    yield from audit.limits
    if which.weak:
        yield (
            f"lag and dry friction of {joint_words(which.weak, which.total)} are not separated by this motion: add "
            "faster motion, ramps of several speeds or steps"
        )
    if which.unidentifiable:
        yield f"{joint_words(which.unidentifiable, which.total)}: no response to a command: record one"
    still = [joint.joint for joint in audit.joints if joint.holds < ENOUGH_HOLDS]
    if still:
        yield f"no rest shows the droop of {joint_words(still, which.total)}: hold some positions for a second or more"
    yield "signid identify gives kp, damping, delay and friction; their scale needs known masses or a gain (--known)"


def _drive_table(audit: ServoAudit) -> Cells:
    unit = " or ".join(dict.fromkeys(joint.unit for joint in audit.joints if joint.unit))
    heads = (
        *("joint", f"range\n[{unit}]>" if unit else "range>", f"speed\n[{unit or '1'}/s]>", "step>", "error>"),
        *("lag\n[ms]>", "71 % at\n[Hz]>", "hysteresis>", "droop>", "scale>", "at\nlimit>"),
    )
    rows = []
    for joint in audit.joints:
        lag = bandwidth = "-"
        if verdict_of(joint) == "identifiable":
            lag = f"{1e3 * joint.lag:.0f} ± {1e3 * TWO_SIDED * joint.lag_std:.0f}"
            bandwidth = figure(joint.bandwidth, 2)
        motion = (figure(x, 2) for x in (joint.speed, joint.quantum, joint.error))
        following = (figure(x, 2) for x in (joint.width, joint.droop, joint.scale))
        rows.append((joint.joint, figure(joint.range), *motion, lag, bandwidth, *following, share(joint.saturated)))
    return Cells(heads, tuple(rows))
