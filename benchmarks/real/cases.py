"""Known missing physics of a UR10e, a TX40, the EMPS, a Panda and an LWR4+."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.extend.holdout import residual_rows
from signid.identify import Identification
from signid.model import Model, load_model
from signid.regression.session import prepare

from .data import (
    HELD_OUT,
    LINK_SIDE,
    LOADED,
    ROBOTS,
    UNLOADED,
    blocks,
    data,
    parameter,
    recording,
    ur10e_model,
    ur10e_recording,
    without,
)
from .row import Array, Row, Target, attempt, first_is, found, rms, within

PAYLOAD = 2.805  # mass weighed by the authors of the recordings [kg]
# bounds [1]: mass error, held-out error over the unloaded fit's, gain of the roll-out at 0.5 s
NEAR, ERROR, ROLLED = 0.05, 1.3, 5.0
SPEED = ("stribeck_friction", "quadratic_friction", "viscous_friction", "asymmetric_friction")


def payload() -> Iterator[Row]:
    """Diagnose the loaded recording with the unloaded robot's model, without and with an unloaded reference."""
    loaded, healthy = ur10e_recording(LOADED), [ur10e_recording(UNLOADED[0])]
    for text, reference in (("2.805 kg payload", []), ("the same, unloaded recording as reference", healthy)):
        yield attempt(
            "UR10e",
            text,
            lambda reference=reference: signid.diagnose(ur10e_model(), [loaded], reference=reference),  # type: ignore[misc]
            _payload_targets,
        )[0]


def _payload_targets(diagnosis: Diagnosis) -> Sequence[Target]:
    carried = found(diagnosis, "payload")
    mass = carried[0].law.parameters["mass"] if carried else 0.0
    usual = _unloaded_error(diagnosis.cutoff)
    worst = float(np.max(diagnosis.after.held_out_rms / usual))
    error = " ".join(f"{x:.2f}" for x in diagnosis.after.held_out_rms / usual)
    targets = [
        first_is(diagnosis, "payload"),
        within("mass", mass, PAYLOAD, NEAR, "kg"),
        Target("held-out error over the unloaded fit's", error, f"each <= {ERROR}", worst <= ERROR),
    ]
    if diagnosis.rollout_before is None or diagnosis.rollout_after is None:
        return [*targets, Target("roll-out 0.5 s", "none", f">= {ROLLED} times better", False)]
    before, after = (1e3 * rms(r.rms(0.5)) for r in (diagnosis.rollout_before, diagnosis.rollout_after))
    better = f"{before:.1f} -> {after:.1f} mrad ({before / after:.1f} times)"
    return [*targets, Target("roll-out 0.5 s", better, f">= {ROLLED} times better", before >= ROLLED * after)]


def _unloaded_error(cutoff: float) -> Array:
    """Held-out residual (n,) [N.m] of the unloaded robot's own fit in the same band."""
    options = signid.Options(effects=(), cutoff=cutoff)
    model, held_out = ur10e_model(), ur10e_recording(HELD_OUT)
    session = prepare(model.robot, [held_out], [held_out], options)
    rest = residual_rows(session.task, model, session.held_out).residual
    return np.sqrt(np.nanmean(rest**2, axis=0))


def jointwise() -> Iterator[Row]:
    """Diagnose recordings of single joints at many speeds: friction is not linear in speed."""
    logs = [ur10e_recording(f"20_01_22_joint_{j}", "jointwise_motion") for j in range(1, 7)]
    yield attempt(
        "UR10e",
        "speed dependence of friction",
        lambda: signid.diagnose(ur10e_model(), logs, held_out=logs),
        _speed_targets,
    )[0]


def _speed_targets(diagnosis: Diagnosis) -> Sequence[Target]:
    speed = [f for f in diagnosis.findings if f.law.effect.name in SPEED]
    first = bool(diagnosis.findings) and diagnosis.findings[0] in speed
    what = ", ".join(f"{f.law.effect.name} {diagnosis.robot.joints[f.law.joints[0]]}" for f in speed)
    return [Target("dependence on speed named first", what or "none", "a law of speed", first)]


COUPLING = {"inertia": 0.00964, "viscous": 0.616, "coulomb": 1.95}  # published [kg.m2], [N.m.s/rad], [N.m]
COUPLED, WELL = 0.2, (0.98, 0.97)  # relative tolerance [1]; least held-out R2 of joints 5 and 6
BLOCK, EVERY = 0.75, 3  # block length [s]; every third block is held out
DRIVE = {"mass": 95.154, "viscous +": 166.7061, "coulomb +": 20.1440, "viscous -": 240.4236, "coulomb -": 20.6277}
SAME = 0.03  # relative tolerance of the published EMPS parameters [1]
PUBLISHED = ("asymmetric_friction",)  # effects of the published model
HAND, FLANGE = 0.73, 0.1  # mass of the hand, tolerance of the mass at the flange [kg]
HAND_AT = 0.137  # distance of the hand's centre from the frame of joint 7 [m]
FRICTION = ("viscous_friction", "coulomb_friction")
LEVEL = 0.25  # relative tolerance of Coulomb levels against the identified ones [1]


def tx40() -> Iterator[Row]:
    """TX40 with every third block of its 9 s held out, because the motion changes in the last third."""
    robot = signid.load_robot(data() / "staubli_tx40" / "tx40.urdf")
    whole = recording("staubli_tx40", "exciting_traj", robot)
    with tempfile.TemporaryDirectory() as folder:
        train, held_out = blocks(whole, robot, BLOCK, EVERY, Path(folder))
        model = signid.identify(robot, train, held_out=held_out).model
        yield attempt("TX40", "wrist coupling", lambda: signid.diagnose(model, train, held_out=held_out), _wrist)[0]


def _wrist(diagnosis: Diagnosis) -> Sequence[Target]:
    coupled = [f for f in found(diagnosis, "joint_coupling") if set(f.law.joints) == {4, 5}]
    numbers = coupled[0].law.parameters if coupled else dict.fromkeys(COUPLING, 0.0)
    before, after = diagnosis.before.held_out_r2, diagnosis.after.held_out_r2
    fits = [
        Target(
            f"held-out R2 of joint {j + 1}", f"{before[j]:.3f} -> {after[j]:.3f}", f"> {least}", bool(after[j] > least)
        )
        for j, least in zip((4, 5), WELL, strict=True)
    ]
    near = [within(key, numbers[key], wanted, COUPLED) for key, wanted in COUPLING.items()]
    return [first_is(diagnosis, "joint_coupling", (4, 5)), *near, *fits]


def emps() -> Iterator[Row]:
    """EMPS with asymmetric friction; the run with added pulses is held out."""
    robot = signid.load_robot(ROBOTS / "emps" / "robot.urdf")
    train, held_out = (recording("emps_janot", f"emps_{name}", robot) for name in ("train", "pulses"))
    model = signid.identify(robot, [train], held_out=[held_out]).model
    published = signid.identify(robot, [train], held_out=[held_out], options=signid.Options(effects=PUBLISHED))
    yield attempt(
        "EMPS",
        "asymmetric friction",
        lambda: signid.diagnose(model, [train], held_out=[held_out]),
        lambda diagnosis: _directions(diagnosis, published),
    )[0]


def _directions(diagnosis: Diagnosis, published: Identification) -> Sequence[Target]:
    """Targets: named first, published parameters, smaller held-out residual than the published law."""
    numbers = drive_numbers(published.model)
    before, after = float(diagnosis.before.held_out_rms[0]), float(diagnosis.after.held_out_rms[0])
    law = float(published.fit.held_out_rms[0])
    return [
        first_is(diagnosis, "asymmetric_friction"),
        *(within(key, numbers[key], wanted, SAME) for key, wanted in DRIVE.items()),
        Target("pulses, residual", f"{before:.3f} -> {after:.3f} N", f"< {law:.3f}, of the published law", after < law),
    ]


def drive_numbers(model: Model) -> dict[str, float]:
    """Total parameters of a one-joint model in both directions [kg, N.s/m, N]."""

    def of(effect: str, key: str) -> float:
        return parameter(model, effect, key, (0,))

    level, offset = of("coulomb_friction", "level"), of("torque_offset", "offset")
    out = {"mass": float(model.inertials[0, 0]) + of("armature", "inertia")}
    for sign, name in ((1, "positive"), (-1, "negative")):
        side = "+" if sign > 0 else "-"
        out[f"viscous {side}"] = of("viscous_friction", "coefficient") + of("asymmetric_friction", f"viscous_{name}")
        out[f"coulomb {side}"] = level + sign * offset + of("asymmetric_friction", f"coulomb_{name}")
    return out


def panda() -> Iterator[Row]:
    """Panda without friction; published inertials with a hand that is absent, and without it."""
    robot = signid.load_robot(data() / "panda_gaz2019" / "panda.urdf")
    log = recording("panda_gaz2019", "exciting_traj_1", robot)
    model = signid.identify(robot, [log], options=signid.Options(effects=LINK_SIDE)).model
    bare = without(model, FRICTION)
    levels = np.array([parameter(model, "coulomb_friction", "level", (j,)) for j in range(7)])
    yield attempt(
        "Panda",
        "friction of all joints",
        lambda: signid.diagnose(bare, [log]),
        lambda diagnosis: _dry(diagnosis, levels),
    )[0]
    stated = load_model(data() / "panda_gaz2019" / "panda.urdf")
    stated = replace(stated, laws=model.laws)
    for text, simulation, mass in (("a hand that is not there", _carrying(stated), -HAND), ("no hand", stated, 0.0)):
        yield attempt(
            "Panda",
            text,
            lambda simulation=simulation: signid.diagnose(simulation, [log]),  # type: ignore[misc]
            lambda diagnosis, mass=mass: _flange(diagnosis, mass),  # type: ignore[misc]
        )[0]


def _carrying(model: Model) -> Model:
    """Add the hand at the flange."""
    hand = pin.Inertia(HAND, np.array([-0.01, 0.0, HAND_AT]), np.diag([0.001, 0.0025, 0.0017]))
    inertials = model.inertials.copy()
    inertials[-1] += hand.toDynamicParameters()
    return replace(model, inertials=inertials)


def _dry(diagnosis: Diagnosis, levels: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Sequence[Target]:
    own = np.array([parameter(diagnosis.model, "coulomb_friction", "level", (j,)) for j in range(len(levels))])
    first = diagnosis.findings[0].law.effect.name if diagnosis.findings else "nothing"
    loose = [2 * sum(f.std["level"] for f in found(diagnosis, "coulomb_friction", j)) for j in range(len(levels))]
    text = " ".join(f"{x:.2f}" for x in own)
    asked = "identified " + " ".join(f"{x:.2f}" for x in levels) + f" ± {100 * LEVEL:g} % or 2 std"
    names = {f.law.effect.name for f in diagnosis.causes}
    strange = sorted(names - {*FRICTION, "asymmetric_friction", "stribeck_friction"})
    return [
        Target("first named", first, "friction", first in FRICTION),
        Target(
            "Coulomb levels, N.m", text, asked, bool(np.all(np.abs(own - levels) <= np.maximum(LEVEL * levels, loose)))
        ),
        Target("other causes", ", ".join(strange) or "none"),
    ]


def _flange(diagnosis: Diagnosis, mass: float) -> Sequence[Target]:
    last = len(diagnosis.robot.joints) - 1
    carried = [
        f for f in diagnosis.findings if f.law.effect.name in ("payload", "link_inertia") and last in f.law.joints
    ]
    own = sum(f.law.parameters["mass"] for f in carried)
    first = diagnosis.findings[0] if diagnosis.findings else None
    name = "nothing" if first is None else first.law.effect.name
    targets = [Target("mass at the flange", f"{own:+.3f} kg", f"{mass:+.2f} ± {FLANGE} kg", abs(own - mass) <= FLANGE)]
    if mass:
        targets.append(Target("first named", name, "payload", bool(carried) and first is carried[0]))
    return targets


def lwr4() -> Iterator[Row]:
    """LWR4+ with joints moved in step: nothing is identifiable, and a warning is required."""
    model = load_model(data() / "kuka_lwr4_flobaroid" / "kuka_lwr4.urdf")
    logs = [recording("kuka_lwr4_flobaroid", f"measurements_{k}", model.robot) for k in (1, 2, 3)]
    row, diagnosis = attempt(
        "LWR4+", "nothing; poor excitation", lambda: signid.diagnose(model, logs[:2], held_out=logs[2:]), _poor
    )
    refused = Target("refuses or warns", "refuses", "either", True)
    yield replace(row, targets=(refused,)) if diagnosis is None else row


def _poor(diagnosis: Diagnosis) -> Sequence[Target]:
    warned = [flag for flag in diagnosis.flags if "in step" in flag or "information" in flag]
    sure = [f for f in diagnosis.causes if f.probability > 0.5]
    names = ", ".join(f"{f.law.effect.name} {diagnosis.robot.joints[f.law.joints[0]]}" for f in sure)
    return [
        Target("refuses or warns", "warns" if warned else "silent", "either", bool(warned)),
        Target("verdict", diagnosis.verdict, "not named", diagnosis.verdict != "named"),
        Target("causes with P > .5", names or "none", "none", not sure),
    ]
