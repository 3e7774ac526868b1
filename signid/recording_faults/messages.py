"""What was found -> findings: what, how sure, and how to mend it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite, log

import numpy as np

from ..estimation.excitation import ExcitationVerdict
from ..types import Robot
from .channels import Fault
from .correction import Correction
from .gains import Gains
from .lag import Lags
from .limits import Amount, Beyond
from .result import NOTE, REFUSE, WARN, Finding, named, percent
from .search import Claim

KINDS = {  # what is said of joints, what would be done, and how to mend it
    "torque sign": ("the torque of {} has the wrong sign", "negated", "negate the column"),
    "position sign": ("the position of {} has the wrong sign", "negated", "negate the column"),
    "axis": (
        "{} turns the other way than the description says",
        "with position and torque negated",
        "negate both columns, or reverse the axis in the description",
    ),
    "torque order": ("the torques of {} are exchanged", "put in order", "rename the columns"),
    "position order": ("the positions of {} are exchanged", "put in order", "rename the columns"),
    "joint order": ("positions and torques of {} are exchanged", "put in order", "rename the columns"),
    "degrees": ("the position of {} is in degrees", "in radians", "convert it to radians"),
    "revolutions": ("the position of {} is in revolutions", "in radians", "convert it to radians"),
    "millimetres": ("the position of {} is in millimetres", "in metres", "convert it to metres"),
    "lag": ("the torque of {} is late or early", "shifted", "shift the column"),
}
MEANT = ("torque sign", "torque order", "lag")  # a diagnosis can go on from these: it has laws for them
UNITS = {1e3: "mN.m", 1e-3: "kN.m", 10.197: "kgf.cm", 141.61: "ozf.in", 8.851: "lbf.in"}
NEAR = log(1.35)  # a factor so near a unit's is told as that unit
SPARE = 1.05  # times what is needed at least, is recommended
GROSS, FAR = 5.0, 1.5  # times: units off by more leave nothing to diagnose; torques beyond limits are worth a flag


def claim_findings(claims: Sequence[Claim], joints: Sequence[str], blocks: int) -> Iterator[Finding]:
    """One finding for each kind of sign or unit, one for each exchange; lags are told apart."""
    groups: dict[tuple[str, int], list[Claim]] = {}
    for k, claim in enumerate(claims):
        if claim.kind != "lag":
            groups.setdefault((claim.kind, k if "order" in claim.kind else -1), []).append(claim)
    for (kind, _), group in groups.items():
        about = tuple(joints[j] for j in sorted({j for claim in group for j in claim.joints}))
        rivals = [] if len(group) > 1 else [(r.kind, tuple(joints[j] for j in r.joints)) for r in group[0].rivals]
        before, after = (float(np.mean([getattr(c, key) for c in group])) for key in ("before", "after"))
        sure = min(claim.agreement for claim in group)
        what, how, mend = KINDS[kind]
        told = f"model and friction explain {percent(1 - after)} of the torque instead of {percent(1 - before)}"
        better = f"better in {round(sure * blocks)} of {blocks} parts of the recordings"
        sentence = f"{what.format(named(about))}: {how}, {told} ({better}); {mend}{_or(rivals)}"
        mild = kind in MEANT or any(rival in MEANT for rival, _ in rivals)
        measures = {"explained_before": 1 - before, "explained_after": 1 - after, "agreement": sure}
        yield Finding(kind, about, WARN if mild else REFUSE, measures, sentence, tuple(rivals))


def _or(rivals: Sequence[tuple[str, tuple[str, ...]]]) -> str:
    others = [KINDS[kind][0].format(named(about)) for kind, about in rivals if kind != "lag"]
    return f" (as likely: {'; '.join(others[:3])})" if others else ""


def lag_findings(lags: Lags, done: Correction, joints: Sequence[str]) -> Iterator[Finding]:
    """Lags of all joints as one finding, of single joints one each."""
    before = done.lag[list(done.tau_from)]
    odd = np.flatnonzero((before != 0) | lags.gross).tolist()
    one_clock = len(set(before.tolist())) == 1 and (before[0] != 0 or isfinite(lags.common))
    rest = np.where(lags.share > 0, np.nan_to_num(lags.own), 0.0)
    for group in [odd] if odd and one_clock and len(joints) > 1 else [[j] for j in odd]:
        lag = float(before[group[0]] + (lags.common if isfinite(lags.common) else np.median(rest[group])))
        who, about = (
            ("all joints", tuple(joints))
            if one_clock and len(joints) > 1
            else (named([joints[group[0]]]), (joints[group[0]],))
        )
        side = "late" if lag > 0 else "early"
        told = f"the torque of {who} is recorded {1e3 * abs(lag):.0f} ms {side} against the motion"
        mend = "record both with one clock, or shift the columns by that much"
        yield Finding("lag", about, WARN, {"lag": lag, "share": float(lags.share[group].max())}, f"{told}; {mend}")


def factor_findings(gains: Gains, robot: Robot) -> Iterator[Finding]:
    """Units of all torques, gains of single ones."""
    middle = gains.common
    if middle != 1.0:
        unit = next((name for factor, name in UNITS.items() if abs(log(middle / factor)) < NEAR), "")
        guess = f"they seem to be in {unit}" if unit else _currents(gains, robot)
        told = f"all torques are {middle:.3g} times what the model needs: {guess}"
        severity = REFUSE if abs(log(middle)) > log(GROSS) else WARN
        mend = "convert them to N.m (N), name currents current_J with a torque_constant, or correct the masses"
        yield Finding("units", (), severity, {"factor": middle}, f"{told}; {mend}")
    known = gains.factor[np.isfinite(gains.factor)]
    for j in gains.lone:
        ratio = float(gains.factor[j] / np.median(known))
        told = f"the torque of {named([robot.joints[j]])} is {ratio:.3g} times what the other joints let expect"
        sure = f"± {percent(2 * gains.spread[j])}, and no other mass of a link explains it"
        mend = "check its unit, its torque constant and its gear ratio"
        yield Finding("gain", (robot.joints[j],), WARN, {"factor": ratio}, f"{told} ({sure}); {mend}")


def _currents(gains: Gains, robot: Robot) -> str:
    constant = robot.actuators.torque_constant
    fits = np.abs(np.log(np.where(constant > 0, constant, np.nan) * gains.factor))
    if np.isfinite(fits).any() and np.nanmedian(fits) < NEAR:
        return "they are currents, by the torque constants"
    if gains.common < 1:
        return "they may be currents [A], or torques before the gear"
    return "their unit or the description's masses are wrong"


def unsigned_unit_finding(ratio: float) -> Finding:
    """Absolute torques of a size that no friction makes."""
    told = f"absolute torques are {ratio:.3g} times as large as the model's"
    return Finding("units", (), WARN, {"factor": ratio}, f"{told}: their unit is wrong; convert them to N.m (N)")


def absolute_finding(joints: Sequence[str]) -> Finding:
    """Torque that lost its sign, and is not said to have lost it."""
    told = f"the torque of {named(joints)} is never negative though the simulation's changes its sign"
    mend = "these are absolute values: name the columns abs_tau_JOINT, or say --unsigned (unsigned=True)"
    return Finding("absolute torque", tuple(joints), REFUSE, {}, f"{told}; {mend}")


def unexplained_finding(joint: str, explained: float) -> Finding:
    """Torque that does not belong to its motion."""
    told = f"the torque of {named([joint])} does not follow from its motion: model and friction explain"
    mend = "check that the column is measured, not commanded, and belongs to the joint"
    measures = {"explained": explained}
    return Finding("unexplained torque", (joint,), WARN, measures, f"{told} {percent(explained)} of it; {mend}")


def amount_finding(amount: Amount, joints: int) -> Finding:
    """Too short to tell noise from what is sought."""
    learned = "" if amount.whole == amount.seconds else " to learn from"
    told = f"{amount.seconds:.3g} s of {joints} joint{'s' if joints > 1 else ''}{learned} are too little"
    why = f"{amount.rows} filtered rows a joint for {amount.unknowns} unknowns leave no noise to judge by"
    measures = {"rows": float(amount.rows), "unknowns": float(amount.unknowns), "needed": amount.needed}
    share = amount.whole / amount.seconds if amount.seconds else 1.0
    mend = f"record for {np.ceil(SPARE * share * amount.needed):.0f} s or more"
    return Finding("too little data", (), REFUSE, measures, f"{told}: {why}; {mend}")


def excitation_findings(found: ExcitationVerdict) -> Iterator[Finding]:
    """What the motion cannot tell."""
    share = float(found.shares[0]) if len(found.shares) else 0.0
    for sentence in found.sentences:
        yield Finding("excitation", found.resting, WARN, {"share": share}, sentence)


def channel_finding(fault: Fault, robot: Robot) -> Finding:
    """A clipped, stuck or skipping channel."""
    joint, unit = robot.joints[fault.joint], "N" if robot.prismatic[fault.joint] else "N.m"
    told = {
        "clipping": f"the torque of {joint} is clipped at {fault.value:.4g} {unit} in {fault.times} samples; "
        "raise the limit of drive or logger, or move more gently",
        "stuck torque": f"the torque of {joint} stands still for {fault.value:.2g} s while the joint moves; "
        "check the logger, or cut that part out",
        "skipping position": f"the position of {joint} stands still and then jumps, {fault.times} times, for up "
        f"to {fault.value:.2g} s; samples were lost: leave them empty instead of repeating the last",
    }[fault.kind]
    return Finding(fault.kind, (joint,), WARN, {"count": float(fault.times), "value": fault.value}, told)


def limit_finding(found: Beyond, robot: Robot) -> Finding:
    """Beyond a limit of the description."""
    joint, slides = robot.joints[found.joint], int(robot.prismatic[found.joint])
    units = {"torque": ("N.m", "N"), "velocity": ("rad/s", "m/s"), "position": ("rad", "m")}
    told = f"the {found.kind} of {joint} reaches {found.value:.4g} {units[found.kind][slides]}, beyond its limit"
    mend = "check its unit" if found.kind == "torque" else "check its zero and unit" if found.kind == "position" else ""
    advice = f"{mend}, or correct the description" if mend else "check time and unit, or correct the description"
    severity = WARN if found.kind == "torque" and found.value >= FAR * found.limit else NOTE
    measures = {"value": found.value, "limit": found.limit}
    return Finding(f"{found.kind} limit", (joint,), severity, measures, f"{told} of {found.limit:.4g}; {advice}")
