"""Self-contained HTML pages of results."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING

from ...errors import unexpected
from ...typed import typed
from ...types import Input

if TYPE_CHECKING:
    from ...check import Check
    from ...diagnose import Diagnosis
    from ...identify import Identification
    from ...servo.diagnose import ServoDiagnosis
    from ...servo.identify import ServoIdentification
    from ...servo.validate import ServoValidation
    from ...validate import Validation

    Reported = Check | Diagnosis | Identification | ServoDiagnosis | ServoIdentification | ServoValidation | Validation

PAGES = {  # result type -> module below results/, and function in it that renders its page
    "Check": ("check.page", "check_page"),
    "Diagnosis": ("diagnosis", "diagnosis_page"),
    "Identification": ("identification", "identification_page"),
    "ServoDiagnosis": ("servo_diagnosis", "servo_diagnosis_page"),
    "ServoIdentification": ("servo_identification", "servo_page"),
    "ServoValidation": ("validation", "servo_validation_page"),
    "Validation": ("validation", "validation_page"),
}


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
    if type(result).__name__ not in PAGES:
        wanted = "a Check, a Diagnosis, an Identification or a Validation"
        raise unexpected("report", wanted, result, "what signid.identify returns")
    module, name = PAGES[type(result).__name__]
    page: str = getattr(import_module(f"{__package__}.results.{module}"), name)(result, inputs, command)
    return page
