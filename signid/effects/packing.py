"""Numbers of a position drive as laws of its joint, and back: `Servo` packs them for the compiled closed loop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..servos import JOINT_LAWS, PASSIVE_LAWS, Servo
from ..types import Law
from . import DRIVE_EFFECTS, EFFECTS
from .drive import DriveLaw

MOTOR_FRICTION = "motor_friction"  # effect of the number `load_friction` of a drive


def drive_laws(servo: Servo, joint: int) -> Iterator[Law]:
    """Laws of a drive at the joint of an index: friction, armature and offset of the joint, then laws of the drive."""
    for name in PASSIVE_LAWS:
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
    effect = EFFECTS[MOTOR_FRICTION]
    values = (servo.load_friction, servo.armature, servo.viscous_friction, servo.coulomb_friction, servo.torque_offset)
    return Law(effect, (joint,), dict(zip(effect.parameters, values, strict=True)))


def with_law(servo: Servo, law: Law) -> Servo:
    """A drive with a law of it, or of its joint: friction, armature and offset add up, other numbers are replaced."""
    name = law.effect.name
    if isinstance(law.effect, DriveLaw):
        return law.effect.packed(servo, law.parameters)
    if name == MOTOR_FRICTION:
        return servo.with_(load_friction=law.parameters["coefficient"])
    if name in JOINT_LAWS:
        return servo.with_(**{JOINT_LAWS[name][key]: float(x) for key, x in law.parameters.items()})
    if name in PASSIVE_LAWS:
        return servo.with_(**{name: getattr(servo, name) + law.effect.coefficients(law.parameters)[0]})
    return servo


def packed_drives(laws: Iterable[Law]) -> dict[int, Servo]:
    """Drives by joint of the joints that have laws of drives, with friction, armature and offset of these joints."""
    laws = list(laws)
    found = {law.joints[0]: Servo() for law in laws if isinstance(law.effect, DriveLaw)}
    for law in (law for law in laws if law.joints[0] in found and len(law.joints) == 1):
        [j], name = law.joints, law.effect.name
        found[j] = with_law(found[j], law)
        if name in PASSIVE_LAWS and name != "torque_offset":  # estimates may lie below zero
            found[j] = found[j].with_(**{name: max(getattr(found[j], name), 0.0)})
    return found
