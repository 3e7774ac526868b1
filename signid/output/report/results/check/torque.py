"""Check of recordings with torque -> its description."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .....estimation.excitation import ENOUGH
from .....faults import OF_A_FIT
from .....faults.gravity import WHOLE
from .....types import Array
from ...layout import figure, plural, position_units, share, torque_units
from ...sections import Cells
from ..identification import cutoff_words, excited_words
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
    unit_notes,
    unit_uses,
)

if TYPE_CHECKING:
    from .....check import Check
    from .....recording.sampling import Sampling

HALF = 0.5  # [1] share of identifiable base parameters, below which recordings are limited
IN_SAMPLES = {  # what is looked for in the samples, and the kinds of its faults
    "rows out of order": ("order of rows",),
    "drop-outs or spikes": ("drop-outs", "spikes"),
    "stuck or coarse positions": ("stuck position", "skipping position", "coarse position"),
    "clipped or stuck torque": ("clipping", "stuck torque", "few torque values"),
    "exceeded limits": ("torque limit", "velocity limit", "position limit"),
}
IN_TORQUE = {  # what is looked for by comparison of signed torque with the description
    "wrong sign or axis": ("torque sign", "position sign", "axis"),
    "exchanged joints": ("torque order", "position order", "joint order"),
    "wrong unit, scale or gain": ("degrees", "revolutions", "millimetres", "units", "gain", "position scale"),
    "shifted zero": ("position zero",),
    "late or early torque": ("lag", "long lag"),
    "wrong clock": ("clock", "reversed torque", "reversed positions", "reversed time"),
    "lost sign": ("absolute torque", "square root", "square"),
    "other gravity": ("gravity", "weight"),
    "unexplained torque": ("unexplained torque",),
}


def check_summary(found: Check) -> CheckSummary:
    """Describe the check of recordings with torque."""
    robot, faults, which = found.robot, _faults(found), _identifiable(found)
    given = f"{plural(len(found.recordings), 'recording')} of {plural(len(robot.joints), 'joint')}"
    verdict, headline = _headline(found, faults, which)
    sampled = tuple(dict.fromkeys(note for sampling in found.samplings for note in sampling.notes))
    units = unit_notes([note for recording in found.recordings for note in recording.notes])
    return CheckSummary(
        title=f"{robot.name}: {given}",
        verdict=verdict,
        headline=headline,
        sampling=_sampling(found),
        sampled=sampled,
        units=unit_uses(found.recordings, dict(zip(robot.joints, position_units(robot), strict=True))),
        unit_notes=units,
        gravity=gravity_use(found),
        faults=faults,
        clear=tuple(_clear(found)),
        joints=_joints(found),
        legend=f"{cutoff_words(found.band.cutoff, found.band.position_cutoff)}; explained: share of the torque that "
        "the description with any friction and rotor explains",
        identifiable=which,
        excitation=excited_words(found.excitation),
        advice=tuple(dict.fromkeys((*_of_a_fit(found), *found.advice))),
        notes=tuple(note for note in found.notes if not any(note.endswith(said) for said in (*sampled, *units))),
    )


def _headline(found: Check, faults: Sequence[FaultWords], which: Identifiable) -> tuple[str, str]:
    """Verdict, and a sentence on it with the worst fault or lack."""
    if refusal := found.faults.refusal:
        more = sum(fault.sentence != refusal for fault in faults)
        return UNUSABLE, f"Not usable for identification: {first_part(refusal)}{_more(more)}"
    if faults:
        return FAULTY, f"Usable once this is corrected: {faults[0].worst}{_more(len(faults) - 1)}"
    left = f"{len(which.identifiable)} of {plural(which.total, which.noun)} identifiable"
    left += f", {len(which.unidentifiable)} not" if which.unidentifiable else ""
    if not found.excitation.sufficient:
        weakest = f"{max(float(found.excitation.shares[0]), 0.0):.2%} of the information of a random motion"
        return LIMITED, f"Too little excitation: the weakest direction has {weakest} ({share(ENOUGH)} needed); {left}"
    if len(which.identifiable) < HALF * which.total:
        some = f"only {len(which.identifiable)} of {plural(which.total, which.noun)} identifiable"
        others = f"{len(which.weak)} weakly, {len(which.unidentifiable)} not within the uncertainty of the torque"
        return LIMITED, f"Limited: {some}, {others}"
    return GOOD, f"Good for identification: no fault found, {left}{''.join(f'; {x}' for x in found.advice[:1])}"


def _more(faults: int) -> str:
    return f"; {plural(faults, 'more fault')} below" if faults else ""


def _faults(found: Check) -> tuple[FaultWords, ...]:
    """Faults of the log, the most severe first."""
    named = {f.sentence: FaultWords(f.kind, f.joints, f.sentence) for f in found.faults.findings}
    ordered = dict.fromkeys((*found.faults.flags, *found.flags))
    return tuple(named.get(flag, FaultWords("", (), flag)) for flag in ordered if flag not in _of_a_fit(found))


def _of_a_fit(found: Check) -> tuple[str, ...]:
    """Flags that are no faults of the log, but lacks of its motion."""
    return (*found.excitation.sentences, *(f.sentence for f in found.faults.findings if f.kind in OF_A_FIT))


def _clear(found: Check) -> Iterator[str]:
    """Faults that were looked for and not found."""
    seen = {fault.kind for fault in found.faults.findings}
    for words, kinds in (*IN_SAMPLES.items(), *(IN_TORQUE.items() if found.faults.compared else ())):
        if not seen.intersection(kinds):
            yield words


def gravity_use(found: Check) -> GravityUse:
    """Compare the stated gravity with the weight in the torque."""
    from .....robot.joints import gravity_text, root_link

    if other := next((fault for fault in found.faults.findings if fault.kind == "gravity"), None):
        return GravityUse("differs", first_part(other.sentence))
    stated = np.asarray(found.robot.model.gravity.linear)
    text = f"{gravity_text(stated)} m/s2 in the frame of {root_link(found.robot)}"
    if not found.faults.compared:
        return GravityUse("not judged", f"stated {text}; not judged: no signed torque could be compared with it")
    if not stated.any():
        return GravityUse("agrees", "stated as zero, and no direction explains the torque better")
    weight = found.faults.weight
    known = np.flatnonzero(np.isfinite(weight))
    if not len(known):
        return GravityUse("not judged", f"stated {text}; not judged: the weight hardly shows in any torque")
    low, high = (float(x) for x in (weight[known].min(), weight[known].max()))
    carried = " to ".join(dict.fromkeys(f"{100 * x:.0f}" for x in (low, high))) + " %"
    where = joint_words([found.faults.joints[j] for j in known], len(found.faults.joints))
    if WHOLE[0] <= low and high <= WHOLE[1]:
        return GravityUse("agrees", f"agrees with {text}: {carried} of the stated weight shows in {where}")
    return GravityUse("uncertain", f"stated {text}; the torque of {where} carries {carried} of this weight")


def _sampling(found: Check) -> Cells:
    heads = "recording", "rows>", "used>", "seconds>", "rate\n[Hz]>", "content\n[Hz]>", "clock", "breaks>"
    rows = []
    for name, recording, s in zip(recording_names(found.recordings), found.recordings, found.samplings, strict=True):
        used = share(min(s.rows / max(len(recording), 1), 1.0))
        rates = figure(1 / s.step, 4), figure(s.content_rate, 4)
        rows.append((name, str(len(recording)), used, figure(s.duration), *rates, _clock(s), str(len(s.spans) - 1)))
    return Cells(heads, tuple(rows))


def _clock(s: Sampling) -> str:
    """Kind of the clock, and how uneven its stamps are."""
    if s.clock.kind != "stamps":
        lost = f", {s.clock.missing} rows lost" if s.clock.missing else ""
        return f"{s.clock.kind}, jitter {figure(1e3 * s.clock.jitter, 2)} ms{lost}"
    shortest, longest = (figure(1e3 * x) for x in s.jitter)
    return "stamps, even" if s.uniform or shortest == longest else f"stamps, {shortest} to {longest} ms"


def _joints(found: Check) -> Cells:
    robot, band, faults = found.robot, found.band, found.faults
    length, torque = (" or ".join(dict.fromkeys(unit(robot))) for unit in (position_units, torque_units))
    heads = (
        *("joint", f"range\n[{length}]>", f"speed\n[{length}/s]>", f"torque\n[{torque}]>", f"noise\n[{torque}]>"),
        *("cut-off\n[Hz]>", "rows\nused>", "explained>", "factor>", "sign"),
    )
    ranges, speed, rms = motion_sizes(found)
    columns = (robot.joints, ranges, speed, rms, band.torque_floor, band.per_joint, found.used)
    verdicts = (faults.explained, faults.factor, faults.signs)
    rows = (
        (joint, figure(x), figure(v, 2), figure(t), figure(noise, 2), figure(f), share(used), share(r), figure(k, 2), s)
        for joint, x, v, t, noise, f, used, r, k, s in zip(*columns, *verdicts, strict=True)
    )
    return Cells(heads, tuple(rows))


def motion_sizes(found: Check) -> tuple[Array, Array, Array]:
    """Range of the positions, rms velocity and rms torque of each joint over all recordings, (n,) each [SI units]."""
    rows = np.array([s.rows for s in found.samplings], dtype=float)
    lower, upper = (np.array([getattr(s, key) for s in found.samplings]) for key in ("lower", "upper"))

    def mean(key: str) -> Array:
        values = np.array([getattr(s, key) for s in found.samplings])
        return np.asarray(np.sqrt(np.average(values**2, axis=0, weights=rows)))

    return upper.max(axis=0) - lower.min(axis=0), mean("speed"), mean("torque_rms")


def _identifiable(found: Check) -> Identifiable:
    names = zip(found.base.expressions, found.verdicts, strict=True)
    groups: dict[str, list[str]] = {}
    for name, verdict in names:
        groups.setdefault(verdict, []).append(name)
    return Identifiable(
        "base parameter", *(tuple(groups.get(verdict, ())) for verdict in ("identifiable", "weak", "unidentifiable"))
    )
