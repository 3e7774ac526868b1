"""JSON document, terminal tables and self-contained HTML page of a result, by its type."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from ...errors import unexpected
from ...typed import typed
from ...types import Input
from .documents import Document

if TYPE_CHECKING:
    from ...check import Check
    from ...diagnose import Diagnosis
    from ...identify import Identification
    from ...servo.diagnose import ServoDiagnosis
    from ...servo.identify import ServoIdentification
    from ...servo.validate import ServoValidation
    from ...validate import Validation

    Reported = Check | Diagnosis | Identification | ServoDiagnosis | ServoIdentification | ServoValidation | Validation

WRITERS = {  # result type -> module below results/, and start of the names of its _document, _tables and _page
    "Check": ("check.torque", "check"),
    "Conversion": ("recordings", "conversion"),
    "Diagnosis": ("diagnosis", "diagnosis"),
    "Excitation": ("simulation", "excitation"),
    "Identification": ("identification", "identification"),
    "Inspection": ("inspection", "inspection"),
    "Payload": ("payload", "payload"),
    "Separation": ("simulation", "excitation"),
    "ServoAudit": ("check.drives", "audit"),
    "ServoDiagnosis": ("servo_diagnosis", "servo_diagnosis"),
    "ServoIdentification": ("servo_identification", "servo_identification"),
    "ServoSimulation": ("simulation", "servo_simulation"),
    "ServoValidation": ("validation", "servo_validation"),
    "SimulationRun": ("simulation", "simulation"),
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
    found: Document = _writer(result, "document")(result, inputs, **given)
    return found


def tables(result: Any, **given: Any) -> list[RenderableType]:
    """Headings, tables and sentences of a result, a type in WRITERS, for the terminal; `given` as in `document`."""
    found: list[RenderableType] = _writer(result, "tables")(result, **given)
    return found


def page(result: Any, inputs: Sequence[Input] = (), command: str = "", **given: Any) -> str:
    """Page report.html of a result, a type in REPORTED or ServoAudit; `given` as in `document`."""
    found: str = _writer(result, "page")(result, inputs, command, **given)
    return found


def _writer(result: Any, kind: str) -> Any:
    module, start = WRITERS[type(result).__name__]
    return getattr(import_module(f"{__package__}.results.{module}"), f"{start}_{kind}")


@typed
def report(result: Reported, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a result: a self-contained page, reproducible to the byte.

    Args:
        result: result of `check`, `diagnose`, `diagnose_servos`, `identify`, `identify_servos`, `validate` or
            `validate_servos`.
        inputs: files read besides the recordings; default: the robot description.
        command: shell line that reproduces the page, if any.

    Raises:
        OptionError: the result is of another kind, or the inputs are no sequence of `Input`.
    """
    if isinstance(inputs, str) or not all(isinstance(each, Input) for each in inputs):
        advice = "no file name: save the page with Path('report.html').write_text(signid.report(result))"
        raise unexpected("report", "a list of Input as inputs", inputs, advice)
    if type(result).__name__ not in REPORTED:
        wanted = "a Check, a Diagnosis, an Identification or a Validation"
        raise unexpected("report", wanted, result, "what signid.identify returns")
    return page(result, inputs, command)
