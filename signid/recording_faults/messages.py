"""Findings with their sentences: fault, evidence, correction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite, log

import numpy as np

from ..estimation.excitation import ExcitationVerdict
from ..robot.joints import gravity_text, root_link
from ..types import Array, Robot
from .channels import Amount
from .evidence import Correction, FaultEvidence
from .gravity import GravityEstimate
from .lag_and_gain import Gains, Lags
from .result import REFUSE, WARN, RecordingFault
from .search import Claim

DEGREES = 'convert it to radians, or write [units] q = "deg", on two lines, into a column map (--columns)'
TURNS = 'convert it to radians, or write [units] q = "rev", on two lines, into a column map (--columns)'
METRES = 'convert it to metres, or write [units] q = "mm", on two lines, into a column map (--columns)'
KINDS = {  # kind -> fault of some joints, correction that was tried, advice
    "torque sign": ("the torque of {} has the wrong sign", "negated", "negate the column"),
    "position sign": ("the position of {} has the wrong sign", "negated", "negate the column"),
    "axis": (
        "{} turns in the opposite direction to the description",
        "with position and torque negated",
        "negate both columns, or reverse the axis in the description",
    ),
    "torque order": ("the torques of {} are exchanged", "put in order", "rename the columns"),
    "position order": ("the positions of {} are exchanged", "put in order", "rename the columns"),
    "joint order": ("positions and torques of {} are exchanged", "put in order", "rename the columns"),
    "degrees": ("the position of {} is in degrees", "in radians", DEGREES),
    "revolutions": ("the position of {} is in revolutions", "in radians", TURNS),
    "millimetres": ("the position of {} is in millimetres", "in metres", METRES),
    "lag": ("the torque of {} is late or early", "shifted", "shift the column"),
}
DIAGNOSABLE = ("torque sign", "torque order", "lag")  # faults that a diagnosis can handle, since it has laws for them
UNITS = {1e3: "mN.m", 1e-3: "kN.m", 10.197: "kgf.cm", 141.61: "ozf.in", 8.851: "lbf.in"}  # per N.m
NEAR = log(1.35)  # [nats] largest distance of a factor from that of a unit
UPRIGHT = 1.0  # [degrees] largest angle to an upright or level base that is called so
SPARE = 1.05  # [1] recommended duration over the necessary one
LARGE = 5.0  # [1] factor of units from which on a diagnosis is meaningless


def claim_findings(claims: Sequence[Claim], joints: Sequence[str], blocks: int) -> Iterator[RecordingFault]:
    """One finding per kind of sign or unit, and one per exchange; lags have their own findings."""
    groups: dict[tuple[str, int], list[Claim]] = {}
    for k, claim in enumerate(claims):
        if claim.kind != "lag":
            groups.setdefault((claim.kind, k if "order" in claim.kind else -1), []).append(claim)
    for (kind, _), group in groups.items():
        about = tuple(joints[j] for j in sorted({j for claim in group for j in claim.joints}))
        rivals = [] if len(group) > 1 else [(r.kind, tuple(joints[j] for j in r.joints)) for r in group[0].rivals]
        before, after = (float(np.mean([getattr(c, key) for c in group])) for key in ("before", "after"))
        sure = min(claim.agreement for claim in group)
        fault, how, advice = KINDS[kind]
        gain = f"model and friction explain {_percent(1 - after)} of the torque instead of {_percent(1 - before)}"
        better = f"better in {round(sure * blocks)} of {blocks} blocks of the recordings"
        sentence = f"{fault.format(_named(about))}: {how}, {gain} ({better}); {advice}{_equally_likely(rivals)}"
        mild = kind in DIAGNOSABLE or any(rival in DIAGNOSABLE for rival, _ in rivals)
        measures = {"explained_before": 1 - before, "explained_after": 1 - after, "agreement": sure}
        yield RecordingFault(kind, about, WARN if mild else REFUSE, measures, sentence, tuple(rivals))


def _equally_likely(rivals: Sequence[tuple[str, tuple[str, ...]]]) -> str:
    others = [KINDS[kind][0].format(_named(about)) for kind, about in rivals if kind != "lag"]
    return f" (equally likely: {'; '.join(others[:3])})" if others else ""


def gravity_finding(
    found: GravityEstimate, rivals: Sequence[RecordingFault], evidence: FaultEvidence
) -> RecordingFault:
    """Finding that gravity acts otherwise than the description says, or that the torque carries no weight."""
    robot, blocks = evidence.robot, len(np.unique(evidence.block))
    words = ",".join(f"{x + 0.0:.4g}" for x in found.value)
    gain = (
        f"model and friction explain {_percent(1 - found.after)} of the torque instead of {_percent(1 - found.before)}"
    )
    better = f"better in {round(found.agreement * blocks)} of {blocks} blocks of the recordings"
    others = [rival.sentence.partition(":")[0] for rival in rivals]
    if found.single:
        others.append(f"another zero or first moment of {robot.joints[int(np.argmax(evidence.signed))]}")
    if found.weightless and found.hidden:
        others.append("gravity along an axis that no joint feels")
    equally = f" (equally likely: {'; '.join(others)})" if others else ""
    if found.weightless:
        fact, how = "the recorded torque carries no weight of the robot", "without gravity"
        advice = f"log the whole torque, or state it with --gravity {words}; masses are not identifiable from it"
    else:
        fact = f"gravity acts along {_along(found.value)} of {root_link(robot)} {gravity_text(found.value)}"
        fact, how = f"{fact}: {_mounting(found.value)}", "with it"
        advice = f"state it with --gravity {words}"
    measures = dict(zip(("x", "y", "z", "std_x", "std_y", "std_z"), (*found.value, *found.std), strict=True))
    measures |= {"explained_before": 1 - found.before, "explained_after": 1 - found.after, "gain": found.gain}
    measures |= {"agreement": found.agreement, "single": float(found.single)}
    kinds = tuple((rival.kind, rival.joints) for rival in rivals)
    return RecordingFault("gravity", (), WARN, measures, f"{fact}; {how}, {gain} ({better}){equally}; {advice}", kinds)


def weight_findings(joints: Sequence[str]) -> Iterator[RecordingFault]:
    """Finding on torque of some joints that carries no weight, although that of others does."""
    if joints:
        fact = f"the torque of {_named(joints)} carries no weight of the links, although that of other joints does"
        why = "its drive, a spring or a counterweight compensates it, so masses are not identifiable from it"
        yield RecordingFault("weight", tuple(joints), WARN, {}, f"{fact}: {why}; log the whole torque")


def _along(gravity: Array) -> str:
    """Direction of gravity (3,) in a sentence: "-y"."""
    k = int(np.argmax(np.abs(gravity)))
    plain = np.count_nonzero(gravity) == 1
    return f"{'-' if gravity[k] < 0 else ''}{'xyz'[k]}" if plain else "the direction"


def _mounting(gravity: Array) -> str:
    """How a robot stands in a field of gravity (3,) [m/s2] in the frame of its root link, whose z points up."""
    angle = float(np.degrees(np.arccos(np.clip(-gravity[2] / np.linalg.norm(gravity), -1.0, 1.0))))
    for middle, words in ((0.0, "stands upright"), (90.0, "is mounted on its side"), (180.0, "hangs upside down")):
        if abs(angle - middle) < UPRIGHT:
            return f"the robot {words}"
    return f"its base is inclined by {angle:.0f} degrees"


def lag_findings(lags: Lags, done: Correction, joints: Sequence[str]) -> Iterator[RecordingFault]:
    """One finding for a lag of all joints, else one per joint."""
    before = done.lag[list(done.tau_from)]
    odd = np.flatnonzero((before != 0) | lags.large).tolist()
    one_clock = len(set(before.tolist())) == 1 and (before[0] != 0 or isfinite(lags.common)) and len(joints) > 1
    rest = np.where(lags.share > 0, np.nan_to_num(lags.own), 0.0)
    for group in [odd] if odd and one_clock else [[j] for j in odd]:
        lag = float(before[group[0]] + (lags.common if isfinite(lags.common) else np.median(rest[group])))
        about = tuple(joints) if one_clock else (joints[group[0]],)
        who, side = "all joints" if one_clock else about[0], "late" if lag > 0 else "early"
        fact = f"the torque of {who} is recorded {1e3 * abs(lag):.0f} ms {side} against the motion"
        advice = "record both with one clock, or shift the columns by that time"
        measures = {"lag": lag, "share": float(lags.share[group].max())}
        yield RecordingFault("lag", about, WARN, measures, f"{fact}; {advice}")


def factor_findings(gains: Gains, robot: Robot) -> Iterator[RecordingFault]:
    """Findings on the unit of all torques, and on gains of single joints."""
    middle = gains.common
    if middle != 1.0:
        unit = next((name for factor, name in UNITS.items() if abs(log(middle / factor)) < NEAR), "")
        guess = f"they seem to be in {unit}" if unit else _currents(gains, robot)
        fact = f"all torques are {middle:.3g} times the predicted ones: {guess}"
        advice = "convert them to N.m (N), name currents current_J with a torque_constant, or correct the masses"
        severity = REFUSE if abs(log(middle)) > log(LARGE) else WARN
        yield RecordingFault("units", (), severity, {"factor": middle}, f"{fact}; {advice}")
    known = gains.factor[np.isfinite(gains.factor)]
    for j in gains.lone:
        ratio = float(gains.factor[j] / np.median(known))
        fact = f"the torque of {robot.joints[j]} is {ratio:.3g} times the one that the other joints suggest"
        sure = f"± {_percent(2 * gains.spread[j])}; no other mass of a link explains it"
        advice = "check its unit, its torque constant and its gear ratio"
        yield RecordingFault("gain", (robot.joints[j],), WARN, {"factor": ratio}, f"{fact} ({sure}); {advice}")


def _currents(gains: Gains, robot: Robot) -> str:
    constant = robot.actuators.torque_constant
    fits = np.abs(np.log(np.where(constant > 0, constant, np.nan) * gains.factor))
    if np.isfinite(fits).any() and np.nanmedian(fits) < NEAR:
        return "they are currents, according to the torque constants"
    if gains.common < 1:
        return "they may be currents [A], or torques before the gear"
    return "their unit or the description's masses are wrong"


def unsigned_unit_finding(ratio: float) -> RecordingFault:
    """Finding on absolute torques of a size that friction cannot explain."""
    fact = f"absolute torques are {ratio:.3g} times the predicted ones: their unit is wrong"
    return RecordingFault("units", (), WARN, {"factor": ratio}, f"{fact}; convert them to N.m (N)")


def absolute_finding(joints: Sequence[str]) -> RecordingFault:
    """Finding on absolute torque in columns of signed torque."""
    fact = f"the torque of {_named(joints)} is never negative although the predicted torque changes its sign"
    advice = "these are absolute values: name the columns abs_tau_JOINT, or use --unsigned (unsigned=True)"
    return RecordingFault("absolute torque", tuple(joints), REFUSE, {}, f"{fact}; {advice}")


def unexplained_finding(joint: str, explained: float) -> RecordingFault:
    """Finding on torque that does not belong to its motion."""
    share = _percent(explained)
    fact = f"the torque of {joint} does not follow from its motion: model and friction explain {share} of it"
    advice = "check that the column is measured, not commanded, and belongs to the joint"
    return RecordingFault("unexplained torque", (joint,), WARN, {"explained": explained}, f"{fact}; {advice}")


def amount_finding(amount: Amount, joints: int) -> RecordingFault:
    """Finding on too little data to distinguish noise from unknowns."""
    training = "" if amount.whole == amount.seconds else " of training data"
    fact = f"{amount.seconds:.3g} s{training} of {joints} joint{'s' if joints > 1 else ''} are too little"
    why = f"{amount.rows} filtered rows per joint for {amount.unknowns} unknowns are too few to estimate the noise"
    measures = {"rows": float(amount.rows), "unknowns": float(amount.unknowns), "needed": amount.needed}
    share = amount.whole / amount.seconds if amount.seconds else 1.0
    advice = f"record for {np.ceil(SPARE * share * amount.needed):.0f} s or more"
    return RecordingFault("too little data", (), REFUSE, measures, f"{fact}: {why}; {advice}")


def excitation_findings(found: ExcitationVerdict) -> Iterator[RecordingFault]:
    """Findings on insufficient excitation."""
    share = float(found.shares[0]) if len(found.shares) else 0.0
    for sentence in found.sentences:
        yield RecordingFault("excitation", found.resting, WARN, {"share": share}, sentence)


def _named(joints: Sequence[str]) -> str:
    """Names of joints in a sentence: "a", "joints a and b"."""
    return joints[0] if len(joints) == 1 else f"joints {', '.join(joints[:-1])} and {joints[-1]}"


def _percent(share: float) -> str:
    """Share in a sentence: "97 %"."""
    return f"{100 * share:.0f} %"
