"""All data sets of the gallery by name."""

from __future__ import annotations

from .drive_sets import DRIVE_SETS
from .torque_sets import TORQUE_SETS

SETS = {each.name: each for each in (*TORQUE_SETS, *DRIVE_SETS)}
