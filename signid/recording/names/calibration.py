"""Calibration files of LeRobot: positions in per cent of the calibrated range become angles."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError, shorten
from ...toml_json import read_json
from ...types import Array
from .vocabulary import Change

COUNTS = 4095  # counts of a turn by which LeRobot divides, of motors with 12 bits
PERCENT, SLACK = 100.0, 0.5  # largest share of the range, and what rounding adds [%]
KEYS = ("range_min", "range_max")


class MotorRange(NamedTuple):
    """Calibrated range of a motor [counts]."""

    low: float
    high: float

    @property
    def angle(self) -> float:
        """Size of the range [rad]."""
        return (self.high - self.low) * 2 * np.pi / COUNTS


class Calibrated(NamedTuple):
    """How recorded positions become angles around the middle of their range, and why."""

    change: Change | None  # None: the positions are degrees
    why: str


def read_calibration(path: str | Path) -> Mapping[str, MotorRange]:
    """Read the calibrated range of each motor by its name.

    Raises:
        RecordingError: unreadable file, or no calibration of LeRobot.
    """
    form = '{"shoulder_pan": {"range_min": 812, "range_max": 3310}, ...}'
    try:
        content = read_json(Path(path))
        ranges = {str(name): MotorRange(*(float(each[key]) for key in KEYS)) for name, each in content.items()}
    except OSError as error:
        raise RecordingError(f"calibration {path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise RecordingError(f"{path} is no calibration of LeRobot; expected {form}") from error
    bad = [
        name for name, each in ranges.items() if not (np.isfinite(each).all() and 0 < each.high - each.low <= COUNTS)
    ]
    if bad or not ranges:
        fault = f"has no valid range of {shorten(bad)}" if bad else "names no motor"
        raise RecordingError(f"{path} {fault}; expected {form} with 0 < range_max - range_min <= {COUNTS}")
    return ranges


def calibrated(values: Mapping[str, Array], ranges: Mapping[str, MotorRange]) -> dict[str, Calibrated]:
    """Conversion of the positions of the motors that have a range; values: (N,) [% or deg] by name of the motor.

    Positions of one motor beyond 100 are degrees, and so are those of all but grippers; positions of one motor beyond
    the half of its range in degrees are per cent. A gripper has 0 to 100 %.
    """
    ends = {name: (float(np.nanmin(x, initial=0.0)), float(np.nanmax(x, initial=0.0))) for name, x in values.items()}
    grippers = {name for name, (low, _) in ends.items() if "gripper" in name.lower() and low >= -SLACK}
    most = {name: max(-low, high) for name, (low, high) in ends.items() if name in ranges and name not in grippers}
    degrees = any(size > PERCENT + SLACK for size in most.values())
    sure = any(size > np.degrees(ranges[name].angle) / 2 + SLACK for name, size in most.items())
    found: dict[str, Calibrated] = {}
    for name in values:
        if name not in ranges:
            continue
        angle = ranges[name].angle
        whole = f"{np.degrees(angle):.4g} degrees, the range in the calibration file"
        if name in grippers:
            change = Change(angle / PERCENT, 1.0, -angle / 2)
            found[name] = Calibrated(change, f"0 to 100 % of {whole}; zero in its middle is assumed: CHECK")
        elif degrees:
            found[name] = Calibrated(None, "one joint goes beyond 100, so these are degrees")
        else:
            caveat = "" if sure else "; these may be degrees: CHECK"
            found[name] = Calibrated(Change(angle / (2 * PERCENT)), f"-100 to 100 % of {whole}{caveat}")
    return found
