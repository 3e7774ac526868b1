"""Validation of models on recordings: torque and roll-out errors per joint, without any fit.

Every model is evaluated on the same rows: same band and filter, without the rows in which a joint stands still, since
dry friction can take any value there.
"""

from .run import HORIZON, ValidatedModel, Validation, validate

__all__ = ["HORIZON", "ValidatedModel", "Validation", "validate"]
