"""Validation of given models on recordings: torque and roll-out errors per joint, nothing fitted.

Every model is judged on the same rows: same band, same filter, and the same rows left out where a joint stands still,
since dry friction can take any value there.
"""

from .result import ValidatedModel, Validation
from .run import validate

__all__ = ["ValidatedModel", "Validation", "validate"]
