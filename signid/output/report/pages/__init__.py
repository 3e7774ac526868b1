"""Self-contained HTML pages of results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ....errors import unexpected
from ....typed import typed
from ....types import Input

if TYPE_CHECKING:
    from ....check import Check
    from ....diagnose import Diagnosis
    from ....identify import Identification
    from ....servo.diagnose import ServoDiagnosis
    from ....servo.identify import ServoIdentification
    from ....servo.validate import ServoValidation
    from ....validate import Validation

    Reported = Check | Diagnosis | Identification | ServoDiagnosis | ServoIdentification | ServoValidation | Validation


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
    from ....check import Check
    from ....diagnose import Diagnosis
    from ....identify import Identification
    from ....servo.diagnose import ServoDiagnosis
    from ....servo.identify import ServoIdentification
    from ....servo.validate import ServoValidation
    from ....validate import Validation
    from ..results.servo_diagnosis import servo_diagnosis_page
    from ..results.servo_identification import servo_page
    from ..results.validation import servo_validation_page, validation_page
    from .check import check_page
    from .diagnosis import diagnosis_page
    from .identification import identification_page

    if isinstance(inputs, str) or not all(isinstance(each, Input) for each in inputs):
        advice = "no file name: save the page with Path('report.html').write_text(signid.report(result))"
        raise unexpected("report", "a list of Input as inputs", inputs, advice)
    if isinstance(result, Check):
        return check_page(result, inputs, command)
    if isinstance(result, Diagnosis):
        return diagnosis_page(result, inputs, command)
    if isinstance(result, Validation):
        return validation_page(result, inputs, command)
    if isinstance(result, ServoDiagnosis):
        return servo_diagnosis_page(result, inputs, command)
    if isinstance(result, ServoIdentification):
        return servo_page(result, inputs, command)
    if isinstance(result, ServoValidation):
        return servo_validation_page(result, inputs, command)
    if not isinstance(result, Identification):
        wanted = "a Check, a Diagnosis, an Identification or a Validation"
        raise unexpected("report", wanted, result, "what signid.identify returns")
    return identification_page(result, inputs, command)
