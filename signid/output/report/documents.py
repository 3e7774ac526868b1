"""Document, terminal tables and page of a result by its type, and the parts that several documents share."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType

from ...errors import readable, unexpected
from ...typed import typed
from ...types import Array, Input, Law, Recording, Robot
from ...version import __version__

if TYPE_CHECKING:
    from ...check import Check
    from ...diagnose import Diagnosis
    from ...estimation.excitation import ExcitationVerdict
    from ...estimation.fit_quality import Fit
    from ...identify import Identification
    from ...recording.sampling import Sampling
    from ...servo.diagnose import PositionFit, ServoDiagnosis
    from ...servo.identify import ServoIdentification
    from ...servo.validate import ServoValidation
    from ...validate import Validation

    Reported = Check | Diagnosis | Identification | ServoDiagnosis | ServoIdentification | ServoValidation | Validation

Document = dict[str, Any]
_NUMBER_LIST = re.compile(r"\[\n *(?:(?:[-+.\deE]+|null),?\n *)+\]")  # one per line; strings have no line ends


def to_json(document: Document) -> str:
    """Encode as strict JSON, a list of numbers on one line; infinity and NaN become null."""
    text = json.dumps(_strict(document), indent=2, allow_nan=False, ensure_ascii=False)
    return _NUMBER_LIST.sub(lambda found: " ".join(found[0].split()).replace("[ ", "[").replace(" ]", "]"), text) + "\n"


def _strict(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _strict(value.tolist())
    return None if isinstance(value, float) and not isfinite(value) else value


def excitation_verdict(excitation: ExcitationVerdict) -> Document:
    """Verdict on the excitation of the base parameters."""
    return {
        "sufficient": excitation.sufficient,
        "weakest_share": float(excitation.shares[0]) if len(excitation.shares) else None,
        "cannot_tell": [list(names) for names in excitation.weak],
        "resting": list(excitation.resting),
        "in_step": [list(joints) for joints in excitation.in_step],
        "too_small": list(excitation.small),
    }


def fit_document(fit: Fit | PositionFit) -> Document:
    """Quality of the prediction of torque or position, per joint."""
    sizes = picked(fit, "train_rms held_out_rms noise_floor held_out_r2")
    return {"joints": list(fit.joints), "unit": list(fit.unit), **{key: x.tolist() for key, x in sizes.items()}}


def fit_with_errors(fit: Fit) -> Document:
    """The same beside the rms of all that no model could predict, `irreducible_rms`."""
    return {**fit_document(fit), "irreducible_rms": fit.irreducible_rms.tolist()}


def rms(values: Array) -> Array:
    """Root mean square of values: (N, n) [any unit] over finite rows, (n,) [any unit]; NaN if there are none."""
    known = np.isfinite(values)
    mean = np.sum(np.where(known, values, 0.0) ** 2, axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(np.where(known.any(axis=0), np.sqrt(mean), np.nan))


def description(robot: Robot) -> Input:
    """The description file of a robot."""
    return Input(readable(robot.path), robot.sha256, "description")


def recorded(recording: Recording, sampling: Sampling) -> Document:
    """A recording, the clock of its rows [s], and the rate at which it has content of its own [Hz]."""
    clock = sampling.clock
    return {
        "path": recording.path,
        "clock": {"kind": clock.kind, "period": sampling.step, "jitter": clock.jitter},
        "content_rate": sampling.content_rate,
    }


def stamps_clock(period: float) -> Document:
    """The clock of rows whose stamps are taken as they are; `period` [s]."""
    return {"kind": "stamps", "period": period, "jitter": 0.0}


def once(files: Iterable[Input]) -> list[Input]:
    """Remove repeated files."""
    return list({(file.path, file.sha256): file for file in files}.values())


def provenance(recordings: Iterable[Input], others: Iterable[Input], seed: int) -> Document:
    """Input files without repetitions, seed and version of a result."""
    files = [file._asdict() for file in once([*recordings, *others])]
    return {"inputs": files, "seed": seed, "version": __version__}


def opening(schema: str, robot: Robot) -> Document:
    """Schema of a document, and names of the robot and its joints."""
    return {"schema": schema, "robot": robot.name, "joints": list(robot.joints)}


def ending(result: Any, recordings: Iterable[Input], others: Iterable[Input], seed: int) -> Document:
    """Flags and notes of a result, and its provenance."""
    return {"flags": list(result.flags), "notes": list(result.notes), **provenance(recordings, others, seed)}


def picked(source: object, names: str) -> Document:
    """Some attributes of an object, by name."""
    return {name: getattr(source, name) for name in names.split()}


def law_units(robot: Robot, law: Law) -> dict[str, str]:
    """Units of the parameters of a law at its joint."""
    prismatic = bool(len(law.joints) == 1 and robot.prismatic[law.joints[0]])
    return {key: kind.unit_at(prismatic) for key, kind in law.effect.parameters.items()}


WRITERS = {  # result type -> module below results/, and start of the names of its _document, _tables and _page
    "Check": ("check", "check"),
    "Conversion": ("recordings", "conversion"),
    "Diagnosis": ("diagnosis", "diagnosis"),
    "Excitation": ("recordings", "excitation"),
    "Identification": ("identification", "identification"),
    "Inspection": ("identification", "inspection"),
    "Payload": ("identification", "payload"),
    "Separation": ("recordings", "excitation"),
    "ServoAudit": ("check", "audit"),
    "ServoDiagnosis": ("servo_diagnosis", "servo_diagnosis"),
    "ServoIdentification": ("servo_identification", "servo_identification"),
    "ServoSimulation": ("recordings", "servo_simulation"),
    "ServoValidation": ("validation", "servo_validation"),
    "SimulationRun": ("recordings", "simulation"),
    "UnusableRecordings": ("check_page", "unusable"),
    "Validation": ("validation", "validation"),
}
REPORTED = (
    *("Check", "Diagnosis", "Identification", "Validation"),
    *("ServoDiagnosis", "ServoIdentification", "ServoValidation"),
)


def document(result: Any, inputs: Sequence[Input] = (), **given: Any) -> Document:
    """Content of the JSON document of a result.

    Args:
        result: of a type in WRITERS.
        inputs: files read besides the recordings; default: the robot description.
        given: what the result does not hold, `seed`, or `robot`, the name of a robot.
    """
    content: Document = _writer(result, "document")(result, inputs, **given)
    return content


def tables(result: Any, **given: Any) -> list[RenderableType]:
    """Headings, tables and sentences of a result, a type in WRITERS, for the terminal; `given` as in `document`."""
    lines: list[RenderableType] = _writer(result, "tables")(result, **given)
    return lines


def page(result: Any, inputs: Sequence[Input] = (), command: str = "", **given: Any) -> str:
    """Page report.html of a result, a type in REPORTED or ServoAudit; `given` as in `document`."""
    html: str = _writer(result, "page")(result, inputs, command, **given)
    return html


def _writer(result: Any, kind: str) -> Any:
    module, start = WRITERS[type(result).__name__]
    return getattr(import_module(f"{__package__}.results.{module}"), f"{start}_{kind}")


@typed
def report(result: Reported, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a result: a self-contained page, reproducible to the byte.

    >>> page = signid.report(signid.check("3r", "robots/3r/recording.parquet"))

    Args:
        result: result of `check`, `diagnose`, `diagnose_servos`, `identify`, `identify_servos`, `validate` or
            `validate_servos`.
        inputs: files read besides the recordings; default: the robot description.
        command: shell line that reproduces the page, if any.

    Raises:
        OptionError: the result is of another kind, or the inputs are no sequence of `Input`.
    """
    if isinstance(inputs, str) or not all(isinstance(entry, Input) for entry in inputs):
        advice = "no file name: save the page with Path('report.html').write_text(signid.report(result))"
        raise unexpected("report", "a list of Input as inputs", inputs, advice)
    if type(result).__name__ not in REPORTED:
        wanted = "a Check, a Diagnosis, an Identification or a Validation"
        raise unexpected("report", wanted, result, "what signid.identify returns")
    return page(result, inputs, command)
