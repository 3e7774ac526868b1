"""Numbers of a position drive as laws of its joint, and back: `Servo` packs them for the compiled closed loop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ..servos import JOINT_LAWS, PASSIVE, Servo
from ..types import Law
from . import DRIVE_EFFECTS, EFFECTS
from .base import BodyLaw
from .drive import DriveLaw

MOTOR = "motor_friction"  # effect of the number `load_friction` of a drive


def drive_laws(servo: Servo, joint: int) -> Iterator[Law]:
    """Laws of a drive at the joint of an index: friction, armature and offset of the joint, then laws of the drive."""
    for name in PASSIVE:
        if value := getattr(servo, name):
            yield Law(EFFECTS[name], (joint,), EFFECTS[name].physical([value], {}))
    for name, numbers in JOINT_LAWS.items():
        values = {key: float(getattr(servo, number)) for key, number in numbers.items()}
        if next(iter(values.values())):
            yield Law(EFFECTS[name], (joint,), values)
    if servo.load_friction:
        yield motor_friction(servo, joint)
    for effect in DRIVE_EFFECTS:
        if (parameters := effect.stated(servo)) is not None:
            yield Law(effect, (joint,), parameters)


def motor_friction(servo: Servo, joint: int) -> Law:
    """Friction by motor torque at a joint; its torque depends on the other laws of the joint, so it repeats them."""
    effect = EFFECTS[MOTOR]
    values = (servo.load_friction, servo.armature, servo.viscous_friction, servo.coulomb_friction, servo.torque_offset)
    return Law(effect, (joint,), dict(zip(effect.parameters, values, strict=True)))


def packed_drives(laws: Iterable[Law]) -> dict[int, Servo]:
    """Drives by joint of the joints that have laws of drives, with friction, armature and offset of these joints."""
    laws = list(laws)
    found = {law.joints[0]: Servo() for law in laws if isinstance(law.effect, DriveLaw)}
    for law in (law for law in laws if law.joints[0] in found and len(law.joints) == 1):
        [j], name = law.joints, law.effect.name
        if isinstance(law.effect, DriveLaw):
            found[j] = law.effect.packed(found[j], law.parameters)
        elif name == MOTOR:
            found[j] = found[j].with_(load_friction=law.parameters["coefficient"])
        elif name in JOINT_LAWS:
            found[j] = found[j].with_(**{JOINT_LAWS[name][key]: x for key, x in law.parameters.items()})
        elif name in PASSIVE:
            value = getattr(found[j], name) + law.effect.coefficients(law.parameters)[0]
            found[j] = found[j].with_(**{name: value if name == "torque_offset" else max(value, 0.0)})
    return found


def joint_laws(laws: Iterable[Law]) -> tuple[Law, ...]:
    """Laws without those of drives and without friction by the torque of their motors."""
    return tuple(law for law in laws if not isinstance(law.effect, DriveLaw) and law.effect.name != MOTOR)


def left_out(laws: Sequence[Law]) -> list[Law]:
    """Laws at joints with drives that the closed loop of commands does not have, but for those of bodies."""
    drives = packed_drives(laws)
    acts = (law for law in joint_laws(laws) if any(law.effect.coefficients(law.parameters)))
    return [
        law
        for law in acts
        if drives.keys() & set(law.joints)
        and law.effect.name not in (*PASSIVE, *JOINT_LAWS)
        and not isinstance(law.effect, BodyLaw)
    ]


def beside_drives(laws: Sequence[Law]) -> tuple[Law, ...]:
    """Laws that no `Servo` holds."""
    drives = packed_drives(laws)
    return tuple(law for law in joint_laws(laws) if law.effect.name not in PASSIVE or law.joints[0] not in drives)
