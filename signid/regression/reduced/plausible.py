"""Checks of the factors in a file: rows of recordings could have given them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ...effects import EFFECTS
from ...errors import OptionError
from ...types import Array, BaseMap, Robot
from ..bandwidth import Band
from ..factors import Factors, JointFactors, Node, RowSample
from ..rows import Task

LARGEST = 1e30  # magnitude of a sum of squares in SI units over the longest recordings
SMALLEST = 1e-60  # such a sum of squares that is not zero overflows in ratios
MOST_ROWS = 10**12  # [rows] of a recording: thirty years at 1 kHz; for damaged and malicious files
MOST_NODES, DEEPEST = 10_000, 40  # sums of a part; level of the largest, 2**40 windows
MOST_PARTS = 100_000  # [parts] of a recording, the same
RATES, COARSEST, WIDTHS = (1e-9, 1e7), 100_000, (0.1, 1000.0)  # [Hz]; samples per row; position cut-off over cut-off
ROUNDING = 1e-6  # [1] relative error of sums


class ImplausibleError(ValueError):
    """The fault, as the end of "... holds"."""


def check_laws(stated: Sequence[Any], robot: Robot) -> None:
    """Check the laws of a header, pairs of an effect and its joints, before anything is computed with them.

    Raises:
        ImplausibleError: a law is unknown, repeated or acts on no joint of the robot.
    """
    known = [(name, tuple(joints)) for name, joints in stated]
    for name, joints in known:
        shown = f"the law {str(name)[:40]!r} at joints {str(joints)[:40]}"
        if not isinstance(name, str) or [j for j in joints if type(j) is not int or not 0 <= j < len(robot.joints)]:
            raise ImplausibleError(shown)
        try:
            effect = EFFECTS[name]
        except OptionError:
            raise ImplausibleError(shown) from None
        if len(joints) != 1 or effect.scope != "joint" or set(effect.parameters) != set(effect.linear()):
            raise ImplausibleError(shown)
    if len(set(known)) < len(known):
        raise ImplausibleError("a law twice at one joint")


def check_band(band: Band, reach: Sequence[int], slow: Array) -> None:
    """Check the filter, whose length follows from these numbers, and reversals.

    Args:
        band: filter.
        reach: samples on either side of a row that must be free of reversals, per joint.
        slow: (n,) [rad/s or m/s] width of a reversal.

    Raises:
        ImplausibleError: a number is out of range.
    """
    if not (
        RATES[0] <= band.rate <= RATES[1] and 1 <= band.factor <= COARSEST and WIDTHS[0] <= band.beyond <= WIDTHS[1]
    ):
        raise ImplausibleError(
            f"a filter of {band.factor} samples per row at {band.rate:.3g} Hz with a position cut-off of "
            f"{band.beyond:.3g} times the other"
        )
    if not all(0 <= samples <= MOST_ROWS for samples in reach):
        raise ImplausibleError("reversals of a negative or endless duration")
    _check_sizes("noise levels", slow, band.velocity_noise, band.torque_floor)
    if not (band.per_joint > 0).all():
        raise ImplausibleError("a cut-off that is not positive")


def check_base(base: BaseMap) -> None:
    """Check the combinations of standard parameters.

    Raises:
        ImplausibleError: they are no base parameters.
    """
    leading = base.independent
    _check_finite("base parameters", base.combination, base.singular_values)
    if leading.size and (leading.min() < 0 or leading.max() >= len(base.labels) or len(set(leading)) < leading.size):
        raise ImplausibleError("base parameters whose leading standard parameters do not exist, or are repeated")
    if np.abs(base.combination[:, leading] - np.eye(base.rank)).max(initial=0.0) > ROUNDING:
        raise ImplausibleError("base parameters that do not contain their leading standard parameter once")
    if base.sees.dtype != bool or np.isnan(base.condition) or base.singular_values.min(initial=0.0) < 0:
        raise ImplausibleError("base parameters without a condition number")


def check_places(places: Iterable[Sequence[Any]], share: Sequence[Any]) -> None:
    """Check the start and the level of each sum over windows, and the number of the part, before memory is used.

    Raises:
        ImplausibleError: the sums overlap, or are too many or too large.
    """
    places, end = list(places), 0
    numbers = [number for place in (*places, share) for number in place]
    if len(places) > MOST_NODES or any(type(number) is not int for number in numbers) or len(share) != 2:
        raise ImplausibleError("sums over windows without numbers")
    for start, level in places:
        if not (end <= start <= MOST_ROWS and 0 <= level <= DEEPEST):
            raise ImplausibleError("sums over windows that overlap, or of too many windows")
        end = start + 2**level
    if not 1 <= share[0] <= share[1] <= MOST_PARTS:
        raise ImplausibleError(f"part {share[0]} of {share[1]}")


def check_sums(nodes: Sequence[Node], task: Task, whole: bool) -> None:
    """Check that rows could have given these sums; those of a `whole` recording contain all lagged rows as well.

    Raises:
        ImplausibleError: no rows could; the message names the joint.
    """
    for node in nodes:
        _check_factors(node.factors, task, whole)


def whole_number(number: float, what: str) -> int:
    """A count that a file holds as a float.

    Raises:
        ImplausibleError: it is negative, fractional, too large or not a number.
    """
    if not (0 <= number <= MOST_ROWS and number == int(number)):
        raise ImplausibleError(f"{number:.6g} as the number of {what}")
    return int(number)


def _check_factors(factors: Factors, task: Task, whole: bool) -> None:
    rows = factors.rows
    for name, joint in zip(task.robot.joints, factors.joints, strict=True):
        try:
            _check_joint(joint, rows, whole)
        except ImplausibleError as error:
            raise ImplausibleError(f"{error} of {name}") from None
    _check_moments("velocities", factors.velocity)
    _check_sizes("accelerations", factors.acceleration)
    squares = np.concatenate([factors.acceleration, np.diag(factors.velocity)])
    if ((squares > 0) & (squares < SMALLEST)).any():
        raise ImplausibleError(f"squares of velocity or acceleration below {SMALLEST:.0e}")
    if rows:
        _check_finite("positions", factors.lower, factors.upper)
        if (factors.lower > factors.upper).any():
            raise ImplausibleError("a lowest position above the highest")
    if factors.sample is not None:
        _check_sample(factors.sample, rows)


def _check_joint(joint: JointFactors, rows: int, whole: bool) -> None:
    grams, counts = joint.grams, joint.counts
    if not 0 <= joint.rows <= rows:
        raise ImplausibleError(f"{joint.rows} of {rows} rows")
    _check_finite("sums", grams, counts, joint.whole, np.array(joint.total))
    _check_moments("sums of products", grams[0])
    _check_moments("sums of products over all rows", joint.whole)
    if (counts < 0).any() or (counts != np.round(counts)).any() or counts.max() > min(counts[0], joint.rows):
        raise ImplausibleError("counts of rows that contradict each other")
    m = len(joint.whole)
    square, every = np.diag(grams[0])[-m:], np.diag(joint.whole)
    slack = ROUNDING * np.abs(every).max(initial=0.0)
    if (square > every + slack).any() or joint.total**2 > joint.rows * every[-1] * (1 + ROUNDING) + slack:
        raise ImplausibleError("larger sums over some rows than over all rows")
    size = np.sqrt(np.abs(np.diag(grams[0])))
    if whole and (np.abs(grams) > np.outer(size, size) * (1 + ROUNDING) + ROUNDING * float(size.max()) ** 2).any():
        raise ImplausibleError("sums of lagged rows that exceed those of the rows")


def _check_sample(sample: RowSample, rows: int) -> None:
    signals = (sample.q, sample.v, sample.torque, sample.slope, sample.columns)
    _check_finite("sampled rows", *signals)
    power = sample.stride > 0 and sample.stride & (sample.stride - 1) == 0
    if not power or (sample.number % sample.stride).any() or len(sample.number) > rows or sample.kept.dtype != bool:
        raise ImplausibleError("sampled rows whose numbers do not fit")


def _check_moments(what: str, gram: Array) -> None:
    """Check that sums of products (m, m) are finite, symmetric and positive semi-definite."""
    _check_finite(what, gram)
    size = np.sqrt(np.abs(np.diag(gram)))
    scale = np.where(size > 0, size, 1.0)
    scaled = gram / scale / scale[:, None]
    if (np.diag(gram) < 0).any() or np.abs(scaled - scaled.T).max(initial=0.0) > ROUNDING:
        raise ImplausibleError(f"{what} that are not symmetric, or squares that are negative,")
    if np.abs(scaled).max(initial=0.0) > 1 + ROUNDING or np.linalg.eigvalsh(scaled).min(initial=0.0) < -ROUNDING:
        raise ImplausibleError(f"{what} that are not positive semi-definite,")


def _check_sizes(what: str, *arrays: Array) -> None:
    _check_finite(what, *arrays)
    if any((array < 0).any() for array in arrays):
        raise ImplausibleError(f"negative {what}")


def _check_finite(what: str, *arrays: Array) -> None:
    for array in arrays:
        if array.dtype.kind != "f" or not (np.abs(array) <= LARGEST).all():
            raise ImplausibleError(f"{what} that are not finite numbers up to {LARGEST:.0e}")


def check_files(files: Sequence[Mapping[str, Any]], notes: Sequence[Any]) -> None:
    """Check that the recordings and notes of a header are text.

    Raises:
        ImplausibleError: they are not, or are too many.
    """
    texts = [text for file in files for text in file.values()]
    if len(files) > MOST_PARTS or len(notes) > MOST_PARTS or not all(isinstance(x, str) for x in (*texts, *notes)):
        raise ImplausibleError("recordings or notes that are no text")
