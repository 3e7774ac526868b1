"""A result as one page for the browser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...types import Input
from .pages import diagnosis_page, identification_page, validation_page

if TYPE_CHECKING:
    from ...diagnose import Diagnosis
    from ...identify import Identification
    from ...validate import Validation


def report(result: Diagnosis | Identification | Validation, inputs: Sequence[Input] = (), command: str = "") -> str:
    """The report.html of a result: it needs nothing else, and is the same for the same result.

    Args:
        result: what `signid.diagnose`, `signid.identify` or `signid.validate` found.
        inputs: what was read besides the recordings; the robot's description if none is given.
        command: that makes the page again, if there is one.
    """
    from ...diagnose import Diagnosis  # here, because an identification does not need it
    from ...validate import Validation

    if isinstance(result, Diagnosis):
        return diagnosis_page(result, inputs, command)
    if isinstance(result, Validation):
        return validation_page(result, inputs, command)
    return identification_page(result, inputs, command)
