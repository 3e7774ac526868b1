"""Ways to estimate base parameters, one a file: weighted least squares and what does better where positions are noisy.

`ESTIMATORS["tls"].estimate` takes what one identification knows, `Given`, and gives an `Estimate`. To add one: write a
file here and add its name below; or put it into another package behind an entry point `signid.estimators`.
"""

from __future__ import annotations

from ...registry import Registry
from .base import Estimator, Given

__all__ = ["ESTIMATORS", "Estimator", "Given"]
ESTIMATORS: Registry[Estimator] = Registry("estimators", __name__, "wls iv tls oe")
