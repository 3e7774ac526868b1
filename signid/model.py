"""Model of a robot: inertial parameters of its bodies and laws at its joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from .effects import EFFECT_NAMES, EFFECTS
from .effects.base import ActuatorLaw, BodyLaw, RecordingLaw, of_kind
from .effects.bodies import body_inertia
from .effects.drive import DriveLaw
from .effects.law import law_torque
from .effects.naming import check_signs, law_at, law_name, law_place, parse_law
from .effects.packing import MOTOR_FRICTION, drive_laws, motor_friction, packed_drives
from .errors import OptionError, RobotError, SignidError, shorten, unexpected
from .frozen import show_with
from .regression.base_parameters import Covariance, from_lower_triangle, lower_triangle, read_covariance
from .regression.factors import Misfit, read_misfit
from .regression.joint_dynamics import JointDynamics
from .regression.motion import Motion
from .regression.rows import Task
from .robot import held_positions, load_robot, robot_from_text, saved_model, with_gravity
from .robot.dynamics import joint_of_row, own_row, standard_parameters as standard_parameters
from .servos import JOINT_LAWS, PASSIVE_LAWS, Marks, Servo, servos_document, servos_from
from .toml_json import check_numbers, check_schema, read_json
from .typed import typed
from .types import INERTIAL, Array, Law, Parameters, Robot

MODEL_SCHEMA = "signid.model/1"
MAX_MODEL_LAWS = 2000
ESTIMATED_KEYS = ("covariance", "misfit", "payload_covariance")  # keys whose numbers have no usual range


@dataclass(frozen=True, eq=False)
class Model(JointDynamics):
    """Rigid bodies and laws: recorded torque = rigid-body torque + sum of the laws."""

    robot: Robot
    inertials: Array  # (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2]
    laws: tuple[Law, ...] = ()
    covariance: Covariance | None = None  # of the identified base parameters
    misfit: Misfit | None = None  # torque that the laws left when the model was identified
    marks: Mapping[str, Marks] = field(default_factory=dict)  # by joint: certainty of the numbers of its drive
    payload_covariance: Array | None = None  # (10, 10) [their units] of the sum of payloads; inf: unidentifiable

    @cached_property
    def servos(self) -> Mapping[str, Servo]:
        """Position drives by joint, in the order of the joints: their laws, packed."""
        drives = packed_drives(self.laws) if any(map(_is_of_drive, self.laws)) else {}
        return {
            joint: replace(drives[j], **self.marks.get(joint, Marks())._asdict())
            for j, joint in enumerate(self.robot.joints)
            if j in drives
        }

    @property
    def joint_laws(self) -> tuple[Law, ...]:
        """Laws without those of drives and without friction by the torque of their motors."""
        return tuple(law for law in self.laws if not _is_of_drive(law))

    @property
    def laws_beside_drives(self) -> tuple[Law, ...]:
        """Laws that no drive holds: friction, armature and offset of a joint with one are its numbers."""
        joints, drives = self.robot.joints, self.servos
        return tuple(
            law for law in self.joint_laws if law.effect.name not in PASSIVE_LAWS or joints[law.joints[0]] not in drives
        )

    def bodies(self) -> pin.Model:
        """New pin.Model with these inertials and the changes by body laws; rotor inertia is its armature."""
        whole = self.robot.model.copy()
        for body, inertial in enumerate(self.inertials):
            whole.inertias[body + 1] = body_inertia(inertial)
        for law in self.of(BodyLaw):
            row = own_row(self.robot, law.joints[0])
            of_kind(law.effect, BodyLaw).reshape(whole, row, joint_of_row(whole, row), **law.parameters)
        return whole

    def whole_inertials(self) -> Array:
        """Inertial parameters (nb, 10) including the body laws [kg, kg.m, kg.m2]."""
        return np.array([body.toDynamicParameters() for body in list(self.bodies().inertias)[1:]]).reshape(-1, 10)

    def of(self, kind: type) -> list[Law]:
        """Laws of one kind, in their order."""
        return [law for law in self.laws if isinstance(law.effect, kind)]

    def inverse(self, motion: Motion) -> Array:
        """Predict the recorded torque (N, n) [N.m or N] along a recorded motion.

        Armature, friction and offset of drives count as laws. Actuator laws are included only if the motion has
        recorded torque.
        """
        whole = self.bodies()
        rotors, whole.armature = whole.armature.copy(), np.zeros(whole.nv)
        acting = replace(self.acted(motion), robot=replace(self.robot, model=whole), predicted=None)
        torque = acting.load + (acting.rates[1] * rotors) @ self.robot.drive
        for law in self.laws:
            known = not isinstance(law.effect, ActuatorLaw) or motion.recorded is not None
            if known and not isinstance(law.effect, BodyLaw | RecordingLaw | DriveLaw):
                rows, added = law_torque(law, acting)
                torque[:, list(rows)] += added
        for law in self.of(RecordingLaw):
            x = replace(acting, predicted=torque).at(law.joints)
            torque[:, list(law.joints)] = of_kind(law.effect, RecordingLaw).recorded_torque(x, **law.parameters)
        return np.asarray(torque)

    def acted(self, motion: Motion) -> Motion:
        """Invert the recording laws: true positions and torque of a recorded motion."""
        q = motion.q.copy()
        torque = np.full_like(q, np.nan) if motion.recorded is None else motion.recorded.copy()
        for law in reversed(self.of(RecordingLaw)):
            j = list(law.joints)
            lost = np.isnan(torque[:, j])
            if law.effect.scope == "pair":
                lost = np.repeat(lost.any(axis=1, keepdims=True), 2, axis=1)
            x = replace(motion, q=q, predicted=np.nan_to_num(torque)).at(law.joints)
            effect = of_kind(law.effect, RecordingLaw)
            q[:, j], true = effect.acted_q(x, **law.parameters), effect.acted_torque(x, **law.parameters)
            torque[:, j] = np.where(lost, np.nan, true)
        return replace(motion, q=q, recorded=None if motion.recorded is None else torque)

    def with_laws(self, *texts: str) -> Model:
        """Model with further laws, each EFFECT[@JOINT][:key=value,...] as `signid simulate --inject` takes it.

        `model.with_laws("coulomb_friction@joint_2:level=1.5", "payload:mass=0.3")`. Without numbers a law has typical
        ones; `signid effects` lists the laws with their units.

        Raises:
            OptionError: the text of a law cannot be read, or its effect, joint or parameters do not exist.
        """
        return replace(self, laws=(*self.laws, *(parse_law(text, self.robot) for text in texts)))

    def save(self, path: str | Path) -> Path:
        """Save as a model.json, which `load_model` reads: the same bytes as those of `signid identify`.

        The file appears when it is complete. A file of the same name is replaced.

        Raises:
            OutputError: the name does not end in .json, or the file cannot be written.
        """
        return Path(show_with("save_model", self, path))

    def document(self) -> dict[str, Any]:
        """Model as JSON, including the robot description.

        Raises:
            RobotError: it has numbers that `load_model` refuses.
        """
        robot, errors = self.robot, self.payload_covariance
        written = {
            "schema": MODEL_SCHEMA,
            "robot": {"name": robot.name, "kind": robot.kind, "description": robot.document},
            "joints": list(robot.joints),
            "held": held_positions(robot),
            "gravity": robot.model.gravity.linear.tolist(),
            "torque_constants": {
                joint: float(x)
                for joint, x in zip(robot.joints, robot.actuators.torque_constant, strict=True)
                if np.isfinite(x)
            },
            "standard_parameters": standard_parameters(robot, self.inertials),
            "effects": [
                {"effect": law.effect.name, "joint": joint, "parameters": parameters}
                for law in self.laws_beside_drives
                for joint, parameters in [law_place(law, robot)]
            ],
            **({} if self.covariance is None else {"covariance": self.covariance.document()}),
            **({} if self.misfit is None else {"misfit": self.misfit.document(robot.joints)}),
            **({} if errors is None else {"payload_covariance": lower_triangle(errors)}),
            **({"servos": servos_document(self.servos, robot.joints)} if self.servos else {}),
        }
        try:
            check_numbers({key: value for key, value in written.items() if key not in ESTIMATED_KEYS})
            if self.servos:
                servos_from(written["servos"], robot.joints)
        except ValueError as error:
            advice = "check masses and lengths of the description, and stated gains"
            raise RobotError(f"the model of {robot.name} has a number that no robot has ({error}); {advice}") from None
        return written


def _is_of_drive(law: Law) -> bool:
    return isinstance(law.effect, DriveLaw) or law.effect.name == MOTOR_FRICTION


ModelSource = Model | Robot | str | Path  # a model, or what `load_model` reads


@typed
def load_model(
    source: str | Path | Robot, actuators: str | Path | None = None, gravity: Sequence[float] | None = None
) -> Model:
    """Load a model.json, a published model by its name, or what a robot description and its actuators file state.

    >>> signid.load_model("3r").with_laws("payload:mass=0.3").gravity([0, 0, 0]).round(1)
    array([0. , 5.5, 0.7])

    gravity: (3,) [m/s2] in the frame of the root link, in the place of that of the source.

    Raises:
        RobotError: the source is neither.
        OptionError: the source is neither a path nor a robot, gravity is not a vector, or actuators of a saved model.
    """
    if not isinstance(source, str | Path | Robot):
        raise unexpected("load_model", "a path, the name of a robot or a Robot", source, '"model.json" or "robot.urdf"')
    if not isinstance(source, Robot) and (saved := saved_model(source)):
        if actuators is not None:
            raise OptionError(f"{source} states its actuators itself; leave actuators out, or load the description")
        model = _read(saved)
        return replace(model, robot=with_gravity(model.robot, gravity))
    robot = source if isinstance(source, Robot) else load_robot(str(source), actuators=actuators)
    robot = with_gravity(robot, gravity)
    return Model(robot, stated_inertials(robot), stated_laws(robot))


def as_model(given: object, verb: str) -> Model:
    """Model that is given as such, as a result with a `model`, or as a robot or a path, which `load_model` reads.

    Raises:
        OptionError: anything else was given to the verb.
        RobotError: invalid file.
    """
    for found in (given, getattr(given, "model", None)):
        if isinstance(found, Model):
            return found
    if isinstance(given, str | Path | Robot):
        return load_model(given)
    raise unexpected(verb, "a Model", given, 'signid.load_model("model.json")')


def stated_inertials(robot: Robot) -> Array:
    """Inertial parameters (nb, 10) of the description [kg, kg.m, kg.m2]."""
    return np.array([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]]).reshape(-1, 10)


def stated_parameters(task: Task) -> Parameters:
    """Standard parameters of the description and the actuators file."""
    known = {(x.effect, x.joints): x.effect.coefficients(x.parameters) for x in stated_laws(task.robot)}
    zeros = ((law, [0.0] * len(law.effect.coefficients(law.effect.example))) for law in task.laws)
    effects = [x for law, zero in zeros for x in known.get((law.effect, law.joints), zero)]
    return Parameters(task.base.labels, np.append(stated_inertials(task.robot), effects))


def stated_laws(robot: Robot) -> tuple[Law, ...]:
    """Laws of the description and its actuators file, where [joint.J.servo] wins over [joint.J]."""
    springs = (
        Law(EFFECTS["spring"], (robot.index(joint),), dict(zip(("stiffness", "rest"), spring, strict=True)))
        for joint, spring in robot.springs.items()
    )
    drives = (
        Law(EFFECTS[name], (j,), EFFECTS[name].physical([value], {}))
        for name in EFFECT_NAMES  # keys of an actuators file are names of effects
        for j, joint in enumerate(robot.joints)
        if np.isfinite(value := float(robot.servo.get(joint, {}).get(name, getattr(robot.actuators, name)[j])))
    )
    return (*drives, *springs)


def fitted_model(task: Task, parameters: Parameters) -> Model:
    """Model of a task's robot with estimated standard parameters."""
    values: dict[int, list[float]] = {}
    for label, value in zip(parameters.labels, parameters.values, strict=True):
        if label.law is not None:
            values.setdefault(label.law, []).append(float(value))
    laws = (
        Law(law.effect, law.joints, law.effect.physical(values[k], law.effect.shape(law.parameters)))
        for k, law in enumerate(task.laws)
    )
    return Model(task.robot, parameters.bodies(), tuple(laws))


def with_servos(model: Model, servos: Mapping[str, Servo], complete: bool = False) -> Model:
    """Model whose joints of these names have these drives, in the place of drives that they had.

    Numbers that a drive states replace laws of the same name at its joint; with `complete`, zeros do so, too.
    """
    at = {model.robot.index(joint): servo for joint, servo in servos.items()}
    mains = {n: n for n in PASSIVE_LAWS} | {name: next(iter(keys.values())) for name, keys in JOINT_LAWS.items()}
    stated = {(name, j) for j, servo in at.items() for name, main in mains.items() if complete or getattr(servo, main)}
    kept = [
        law
        for law in model.laws
        if not (law.joints[0] in at and _is_of_drive(law)) and (law.effect.name, law.joints[0]) not in stated
    ]
    laws = [*kept, *(law for j, servo in sorted(at.items()) for law in drive_laws(servo, j))]
    whole = packed_drives(laws)
    laws = [motor_friction(whole[x.joints[0]], x.joints[0]) if x.effect.name == MOTOR_FRICTION else x for x in laws]
    marks = {joint: Marks(servo.not_identifiable, servo.combined, servo.std) for joint, servo in servos.items()}
    return replace(model, laws=tuple(laws), marks={**model.marks, **marks})


def torque_model(model: Model) -> Model:
    """Model for recorded or applied torque, without the laws of its drives: commands have no effect."""
    return replace(model, laws=tuple(law for law in model.laws if not isinstance(law.effect, DriveLaw)), marks={})


def command_model(model: Model, servos: Mapping[str, Servo], complete: bool = False) -> tuple[Model, tuple[str, ...]]:
    """Model with these drives, as by `with_servos`, and a note on laws that the simulation of commands leaves out."""
    driven = with_servos(model, servos, complete)
    at = {model.robot.index(joint) for joint in servos}
    acts = (law for law in driven.laws_beside_drives if at & set(law.joints) and law.effect.name not in JOINT_LAWS)
    left = [
        law_name(law, model.robot)
        for law in acts
        if any(law.effect.coefficients(law.parameters)) and not isinstance(law.effect, BodyLaw)
    ]
    return driven, (f"the simulation of commands leaves out {shorten(left)}",) if left else ()


def _read(path: Path) -> Model:
    try:
        content = read_json(path)
        if isinstance(content, dict) and (own := content.get("schema")) != MODEL_SCHEMA:
            raise RobotError(
                f"{path} has the schema {own!r}; give a model.json of `signid identify` ({MODEL_SCHEMA!r})"
            )
        effects = content.get("effects") if isinstance(content, dict) else None
        if isinstance(effects, list) and len(effects) > MAX_MODEL_LAWS:
            raise ValueError(f"effects: it has {len(effects)} laws, more than {MAX_MODEL_LAWS}")  # the schema is slow
        check_schema(content, "model")
        described: Mapping[str, str] = content["robot"]
        gravity = content.get("gravity")  # absent in older files
        robot = robot_from_text(
            described["description"], described["kind"], described["name"], lock=content["held"], gravity=gravity
        )
        known: Mapping[str, float] = content.get("torque_constants", {})
        constants = np.array([float(known.get(joint, np.nan)) for joint in robot.joints])
        robot = replace(robot, actuators=replace(robot.actuators, torque_constant=constants))
        entries = [content["standard_parameters"][link] for link in robot.links]
        inertials = [[entry["mass"], *entry["first_moment"], *entry["inertia"]] for entry in entries]
        laws = tuple(
            law_at(EFFECTS[entry["effect"]], robot, entry["joint"], entry["parameters"]) for entry in content["effects"]
        )
        covariance = _covariance(path, content.get("covariance"), len(robot.links))
        if covariance is None:  # estimates may lie below zero; the laws of a description or a diagnosis do not
            laws = tuple(map(check_signs, laws))
        servos = servos_from(content.get("servos", {}), robot.joints)
        misfit = read_misfit(content.get("misfit"), robot.joints)
        errors = content.get("payload_covariance")
        lower = None if errors is None else np.array([np.inf if x is None else float(x) for x in errors])
        carried = None if lower is None else from_lower_triangle(lower, len(INERTIAL))
    except OSError as error:
        raise RobotError(f"cannot read {path}: {error.strerror}") from None
    except OptionError as error:
        raise RobotError(f"{path}: {error}") from None
    except SignidError:
        raise
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        optional = isinstance(error, ValueError) and str(error).startswith("covariance")
        mend = "identify again, or remove the key `covariance`" if optional else "give one that `signid identify` wrote"
        raise RobotError(f"{path} is not a valid model.json ({error}); {mend}") from None
    model = Model(robot, np.array(inertials), laws, covariance, misfit=misfit, payload_covariance=carried)
    return with_servos(model, servos) if servos else model


def _covariance(path: Path, content: Any, bodies: int) -> Covariance | None:
    try:
        return None if content is None else read_covariance(content, bodies)
    except ValueError as error:
        raise RobotError(
            f"the covariance in {path} cannot be read: {error}; identify again, or remove the key `covariance`"
        ) from None
