"""JSON documents of results, as written to files and printed by `--json`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from ....estimation.excitation import ExcitationVerdict
from ....estimation.fit_quality import Fit
from ....identify import Identification
from ....model import standard_parameters
from ....recording.sampling import Sampling
from ....types import BaseMap, Input, Robot
from ....version import __version__
from ..joints import describe_joints
from ..quantities import law_numbers
from .signs import signs_document

if TYPE_CHECKING:
    from ....check import Check
    from ....inspect import Inspection
    from ....recording_faults import RecordingFaults

Document = dict[str, Any]
_NUMBERS = re.compile(r"\[\n *(?:(?:[-+.\deE]+|null),?\n *)+\]")  # one per line; strings have no line ends


def identification_document(result: Identification, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of identification.json.

    Args:
        result: identification.
        inputs: path and sha256 of the files read besides the recordings; default: the robot description.
    """
    robot, values = result.robot, zip(result.base_value, result.estimate.std, result.estimate.value, strict=True)
    return {
        "schema": "signid.identification/1",
        "robot": robot.name,
        "joints": list(robot.joints),
        "base_parameters": [
            {**combination, "value": float(value), "std": float(std), "estimate": float(estimate)}
            for combination, (value, std, estimate) in zip(_base(result.base), values, strict=True)
        ],
        "standard_parameters": standard_parameters(robot, result.parameters.bodies()),
        "physically_consistent": result.physically_consistent,
        "moved": float(result.moved),
        "effects": _effects(result),
        "signs": signs_document(result.signs),
        "fit": fit_document(result.fit),
        "excitation": _excitation(result.excitation),
        "method": result.method,
        "estimator": result.estimate.method,
        "cutoff": {"torque": result.cutoff, "position": result.position_cutoff, "unit": "Hz"},
        "flags": list(result.flags),
        "notes": list(result.notes),
        **provenance(result.inputs, inputs or [description(robot)], result.seed),
    }


def check_document(found: Check, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid check --json`.

    Args:
        found: check.
        inputs: path and sha256 of the files read besides the recordings; default: the robot description.
        seed: seed of the random motion that the excitation is compared with.
    """
    robot, band = found.robot, found.band
    read = [Input(recording.path, recording.sha256, "recording") for recording in found.recordings]
    shares = zip(robot.joints, band.per_joint, found.used, band.torque_floor, strict=True)
    verdicts = zip(_base(found.base), found.std, found.verdicts, strict=True)
    return {
        "schema": "signid.check/1",
        "robot": robot.name,
        "joints": [
            {"name": joint, "cutoff": float(highest), "used": float(used), "noise_floor": float(floor)}
            for joint, highest, used, floor in shares
        ],
        "recordings": [
            {"path": recording.path, **_sampling(sampling)}
            for recording, sampling in zip(found.recordings, found.samplings, strict=True)
        ],
        "cutoff": {"torque": band.cutoff, "position": band.position_cutoff, "unit": "Hz"},
        "base_parameters": [{**base, "std": float(std), "verdict": verdict} for base, std, verdict in verdicts],
        "excitation": _excitation(found.excitation),
        "gross": _faults(found.faults),
        "advice": list(found.advice),
        "flags": list(found.flags),
        "notes": list(found.notes),
        **provenance(read, inputs or [description(robot)], seed),
    }


def inspection_document(found: Inspection, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid inspect --json`.

    Args:
        found: inspection.
        inputs: path and sha256 of the files read; default: the robot description.
        seed: seed of the random states that determine the base parameters.
    """
    robot = found.robot
    return {
        "schema": "signid.inspection/1",
        "robot": robot.name,
        "joints": [entry._asdict() for entry in describe_joints(robot)],
        "links": list(robot.links),
        "base_parameters": _base(found.base),
        "invisible": list(found.invisible),
        "combined": list(found.combined),
        "notes": list(robot.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def to_json(document: Document) -> str:
    """Encode as strict JSON, a list of numbers on one line; infinity and NaN become null."""
    text = json.dumps(_strict(document), indent=2, allow_nan=False, ensure_ascii=False)
    return _NUMBERS.sub(lambda found: " ".join(found[0].split()).replace("[ ", "[").replace(" ]", "]"), text) + "\n"


def _strict(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _strict(value.tolist())
    return None if isinstance(value, float) and not isfinite(value) else value


def _base(base: BaseMap) -> list[Document]:
    units = (unit.replace("m2", "m^2") for unit in base.units)
    return [{"expression": e, "unit": unit} for e, unit in zip(base.expressions, units, strict=True)]


def _effects(result: Identification) -> list[Document]:
    return [
        {
            "effect": law.effect.name,
            "joint": result.robot.joints[law.joints[0]] if len(law.joints) == 1 else None,
            "parameters": {n.key: {"value": n.value, "std": n.std, "unit": n.unit} for n in numbers},
        }
        for law, numbers in zip(result.model.laws, law_numbers(result), strict=True)
    ]


def fit_document(fit: Fit) -> Document:
    """Quality of the torque prediction, per joint."""
    return {
        "joints": list(fit.joints),
        "unit": list(fit.unit),
        "train_rms": fit.train_rms.tolist(),
        "held_out_rms": fit.held_out_rms.tolist(),
        "noise_floor": fit.noise_floor.tolist(),
        "held_out_r2": fit.held_out_r2.tolist(),
    }


def fit_with_errors(fit: Fit) -> Document:
    """The same beside the rms of all that no model could predict, `irreducible_rms`."""
    return {**fit_document(fit), "irreducible_rms": fit.irreducible_rms.tolist()}


def _sampling(found: Sampling) -> Document:
    return {
        "rate": 1 / found.period,
        "duration": found.duration,
        "samples": found.rows,
        "spans": [list(span) for span in found.spans],
        "duplicates": found.duplicates,
        "uniform": found.uniform,
        "spacing": list(found.jitter),
    }


def _excitation(found: ExcitationVerdict) -> Document:
    return {
        "sufficient": found.sufficient,
        "weakest_share": float(found.shares[0]) if len(found.shares) else None,
        "cannot_tell": [list(names) for names in found.weak],
        "resting": list(found.resting),
        "in_step": [list(joints) for joints in found.in_step],
        "too_small": list(found.small),
    }


def _faults(found: RecordingFaults) -> Document:
    columns = (found.joints, found.explained, found.factor, found.lag, found.signs, found.order)
    return {
        "joints": [
            {
                "name": joint,
                "explained": float(share),
                "factor": float(factor),
                "lag": float(lag),
                "sign": s,
                "order": o,
            }
            for joint, share, factor, lag, s, o in zip(*columns, strict=True)
        ],
        "findings": [
            {
                "kind": finding.kind,
                "joints": list(finding.joints),
                "severity": finding.severity,
                "measures": dict(finding.measures),
                "sentence": finding.sentence,
                "alternatives": [{"kind": kind, "joints": list(joints)} for kind, joints in finding.alternatives],
            }
            for finding in found.findings
        ],
    }


def description(robot: Robot) -> Input:
    """The description file of a robot."""
    return Input(robot.path, robot.sha256, "description")


def once(files: Iterable[Input]) -> list[Input]:
    """Remove repeated files."""
    return list({(file.path, file.sha256): file for file in files}.values())


def provenance(recordings: Iterable[Input], others: Iterable[Input], seed: int) -> Document:
    """Input files without repetitions, seed and version of a result."""
    return {
        "inputs": [file._asdict() for file in once([*recordings, *others])],
        "seed": seed,
        "version": __version__,
    }
