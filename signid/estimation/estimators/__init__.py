"""Estimators of base parameters, one per file: weighted least squares, and alternatives for noisy positions.

`ESTIMATORS["tls"].estimate` takes the inputs `Given` of one identification and returns an `Estimate`. To add an
estimator, write a file here and add its name below, or register it under the entry point `signid.estimators`.
"""

from __future__ import annotations

from ...registry import Registry
from .base import Estimator, Given

__all__ = ["ESTIMATORS", "Estimator", "Given"]
ESTIMATORS: Registry[Estimator] = Registry("estimators", __name__, "wls iv tls oe")
