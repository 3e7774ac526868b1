"""Findings of a diagnosis, from the object or its file, and their marks: a ring at a joint, a body or an arrow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import floor, isfinite, log10
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...diagnose import Diagnosis
from ...effects import EFFECTS
from ...effects.base import BodyLaw
from ...effects.naming import law_at, law_place
from ...errors import OptionError, SignidError
from ...model import Model, load_model
from ...robot.dynamics import joint_of_row, own_row
from ...servo.diagnose import ServoDiagnosis
from ...toml_json import read_json
from ...types import TWO_SIDED, Array, Law, Robot
from ..report.documents import law_units
from ..report.results.sentences import causes_words, finding_headline, named, sentence_case
from ..report.results.servo_diagnosis import servo_diagnosis_document
from .track import axis

SCHEMA, MODEL = "signid.diagnosis/1", "model.json"
DRAWN_DENSITY = 3000.0  # density at which a payload is drawn [kg/m3]
MAX_CENTRE_DISTANCE = 1.5  # distance over reach up to which a centre of mass is drawn at its place
MAX_LABEL_PARAMETERS = 5  # maximum number of parameters in a label


class ReplayFinding(NamedTuple):
    """A finding, as far as it is displayed."""

    law: Law
    std: Mapping[str, float | None]
    probability: float
    cause: bool
    stated: Mapping[str, float]


class DriveFinding(NamedTuple):
    """A finding at a position drive, as far as it is displayed."""

    effect: str
    joint: str
    numbers: Mapping[str, tuple[float, float, str]]  # value, std, unit
    probability: float
    cause: bool


class ReplayFindings(NamedTuple):
    """A diagnosis, as far as it is displayed."""

    verdict: str
    after: Model  # the extended simulation
    findings: tuple[ReplayFinding, ...]
    drives: tuple[DriveFinding, ...] = ()
    left: tuple[float, ...] = ()  # unexplained shares [1] of the torque of joints on which the causes hardly act


def read_found(diagnosis: Diagnosis | ServoDiagnosis | str | Path) -> ReplayFindings:
    """Read the findings of a diagnosis, or of diagnosis.json with model.json in the same folder.

    Raises:
        OptionError: the file is not a diagnosis, or model.json is missing.
    """
    if isinstance(diagnosis, Diagnosis):
        shown = (ReplayFinding(x.law, x.std, x.probability, x.role == "cause", x.stated) for x in diagnosis.findings)
        left = tuple(cause.share for cause in diagnosis.without_cause)
        return ReplayFindings(diagnosis.verdict, diagnosis.model, tuple(shown), left=left)
    if not isinstance(diagnosis, str | Path):
        content = servo_diagnosis_document(diagnosis)
        return ReplayFindings(diagnosis.verdict, diagnosis.model, (), tuple(map(_drive_finding, content["findings"])))
    path = Path(diagnosis)
    path = path / "diagnosis.json" if path.is_dir() else path
    if path.is_file() and not path.with_name(MODEL).is_file():
        raise OptionError(f"there is no {MODEL} next to {path}; give diagnosis.json in its original folder")
    try:
        content = read_json(path)
        if content["schema"] != SCHEMA:
            raise OptionError(f"{path} holds {content['schema']!r}; expected {SCHEMA!r} as `signid diagnose` writes it")
        after = load_model(path.with_name(MODEL))
        if after.servos:
            drives = tuple(map(_drive_finding, content["findings"]))
            return ReplayFindings(str(content["verdict"]), after, (), drives)
        laws: list[ReplayFinding] = []
        for x in content["findings"]:
            numbers = x["parameters"]
            values = {key: number["value"] for key, number in numbers.items()}
            laws.append(
                ReplayFinding(
                    law=law_at(EFFECTS[x["effect"]], after.robot, x["joint"], values),
                    std={key: number["std"] for key, number in numbers.items()},
                    probability=float(x["probability"]),
                    cause=x["role"] == "cause",
                    stated={key: number["stated"] for key, number in numbers.items() if "stated" in number},
                )
            )
        findings = tuple(laws)
        left = tuple(float(x["share"]) for x in content.get("unexplained", ()) if x.get("without_cause"))
        return ReplayFindings(str(content["verdict"]), after, findings, left=left)
    except OSError as error:
        raise OptionError(f"cannot read {path}: {error.strerror}; give diagnosis.json of `signid diagnose`") from None
    except SignidError:
        raise
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise OptionError(f"{path} is not a diagnosis.json of `signid diagnose` ({error!r})") from None


def _drive_finding(entry: Mapping[str, Any]) -> DriveFinding:
    numbers = {
        key: (float(x["value"]), float(x["std"] or 0.0), str(x["unit"])) for key, x in entry["parameters"].items()
    }
    where = str(entry["effect"]), str(entry["joint"])
    return DriveFinding(*where, numbers, float(entry["probability"]), entry["role"] == "cause")


@dataclass(frozen=True)
class Mark:
    """A finding, located in the frame of a body of the model (0: world)."""

    kind: str  # joint, body, force, tilt or robot
    body: int
    title: str
    lines: tuple[str, ...]
    cause: bool
    point: tuple[float, ...]  # (3,) [m]
    along: tuple[float, ...]  # (3,) axis [1], force [N] in the world, or rotation of gravity [rad]
    size: float = 0.0  # radius of a body [m]
    time: tuple[float, float] | None = None  # start and end [s]
    joints: tuple[str, ...] = ()  # joints on which the law acts; empty: all


def marks(diagnosis: ReplayFindings, reach: float, origin: float = 0.0) -> list[Mark]:
    """Place a mark for each finding, causes first; `reach` is that of the robot [m].

    Labels count times from the time stamp `origin` [s]. Findings at position drives are rings at their joints.
    """
    robot, placed = diagnosis.after.robot, list[Mark]()
    for finding in diagnosis.findings:
        law = finding.law
        joints = () if law_place(law, robot)[0] is None else tuple(robot.joints[j] for j in law.joints)
        placed.append(replace(_mark(robot, finding, reach, origin), joints=joints))
    for effect, joint, numbers, probability, cause in diagnosis.drives:
        body, along, _ = axis(robot, robot.index(joint))
        title = sentence_case(f"{effect.replace('_', ' ')} of {joint}")
        shown = [
            f"{key.replace('_', ' ')} {_figure(x, TWO_SIDED * std)} {unit}" for key, (x, std, unit) in numbers.items()
        ]
        lines = (*shown[:MAX_LABEL_PARAMETERS], _probability_words(probability))
        placed.append(Mark("joint", body, title, lines, cause, (0.0, 0.0, 0.0), tuple(along), joints=(joint,)))
    return sorted(placed, key=lambda mark: not mark.cause)


def headline(diagnosis: ReplayFindings) -> str:
    """The verdict of a diagnosis in a sentence, with at most three causes."""
    robot = diagnosis.after.robot
    if diagnosis.verdict == "nothing_missing":
        return "Nothing is missing in the simulation."
    if diagnosis.verdict == "undecided":
        return "The recordings do not show whether something is missing."
    causes = [named(robot, x.law, x.std, x.stated) for x in diagnosis.findings if x.cause]
    if diagnosis.drives:
        listed = [f"{x.effect.replace('_', ' ')} of {x.joint}" for x in diagnosis.drives if x.cause]
        return f"Missing or wrongly stated: {', '.join(listed)}."
    return sentence_case(causes_words(causes, diagnosis.verdict == "named", len(robot.joints), diagnosis.left)) + "."


def _probability_words(probability: float) -> str:
    return "probability >0.999" if probability > 0.999 else f"probability {probability:.3f}"


def _mark(robot: Robot, finding: ReplayFinding, reach: float, origin: float) -> Mark:
    """A finding in words, the first parameters with their 95 % intervals, at its place."""
    law, centre = finding.law, (0.0, 0.0, 0.0)
    joint, _ = law_place(law, robot)
    title = sentence_case(finding_headline(named(robot, law, finding.std, finding.stated)))
    p, shown, units = law.parameters, list[str](), law_units(robot, law)
    for key in [key for key in p if key not in law.effect.optional][:MAX_LABEL_PARAMETERS]:
        value, std, unit = p[key], finding.std.get(key), units[key]
        value -= origin if key in ("start", "end") else 0.0
        half = TWO_SIDED * std if std is not None and isfinite(std) else 0.0
        if not (shown and abs(value) < half):  # others are consistent with zero
            shown.append(f"{key.replace('_', ' ')} {_figure(value, half)}{'' if unit == '1' else f' {unit}'}")
    words = (title, (*shown, _probability_words(finding.probability)), finding.cause)
    if {"force_x", "force_y", "force_z"} <= p.keys():
        body = joint_of_row(robot.model, own_row(robot, len(robot.joints) - 1))
        place = tuple(robot.model.inertias[body].lever), tuple(-_vector(p, "force"))
        return Mark("force", body, *words, *place, time=(p["start"], p["end"]))
    if isinstance(law.effect, BodyLaw) and "first_moment_x" in p:
        body, along, _ = axis(robot, law.joints[0])
        title, lines, cause = words
        mass, moment = law.parameters["mass"], _vector(law.parameters, "first_moment")
        at = moment / mass if mass else np.full(3, np.inf)
        if np.linalg.norm(at) < MAX_CENTRE_DISTANCE * reach:
            where = ", ".join(f"{1000 * x:z.0f}" for x in at)
            lines = (lines[0], f"centre of mass at {where} mm in the joint frame", lines[-1])
        else:  # too far away for a mass of this link
            at = robot.model.inertias[body].lever
        radius = float(np.cbrt(3 * abs(mass) / (4 * np.pi * DRAWN_DENSITY)))
        return Mark("body", body, title, lines, cause, tuple(at), tuple(along), min(radius, reach / 4))
    if law.effect.name == "base_tilt":
        return Mark("tilt", 0, *words, centre, (float(p["x"]), float(p["y"]), 0.0))
    if joint is None:
        return Mark("robot", 0, *words, centre, (0.0, 0.0, 1.0))
    body, along, _ = axis(robot, law.joints[0])
    return Mark("joint", body, *words, centre, tuple(along))


def _figure(value: float, half: float) -> str:
    """Format a value and the half-width of its interval to two digits of the latter, or three digits if it is 0."""
    if half <= 0:
        return f"{value:.3g}"
    places = max(0, 1 - floor(log10(half)))
    return f"{value:.{places}f} ± {half:.{places}f}" if places < 7 else f"{value:.3g} ± {half:.2g}"


def _vector(numbers: Mapping[str, float], key: str) -> Array:
    return np.array([numbers[f"{key}_{axis}"] for axis in "xyz"])
