"""Search box of the standard parameters: around the description, or from a TOML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import OptionError
from ...toml_json import read_toml
from ...types import Array, BaseMap, Estimate, Frozen, Parameters, pseudo_inertia
from ..feasible.problem import TO_INERTIAL, coefficient_sizes, feasible_prior, inertial, pack, positive

_MASS = (0.2, 3.0)  # [1] smallest and largest mass over that of the description
_HUGE = 1e100  # largest number in a bounds file
_NEAR = 0.05  # [m] largest shift of a centre of mass, or twice the radius of gyration if that is larger
_ROWS = {"mass": slice(0, 1), "first_moment": slice(1, 4), "inertia": slice(4, 10)}


@dataclass(frozen=True, eq=False)
class Bounds(Frozen):
    """Smallest and largest values of the p standard parameters."""

    lower: Array  # (p,) [unit of each]
    upper: Array  # (p,) [unit of each]

    def __post_init__(self) -> None:
        """Copy and check the arrays."""
        super().__post_init__()
        if self.lower.shape != self.upper.shape or not np.isfinite([self.lower, self.upper]).all():
            raise ValueError("the bounds are not two vectors of equal length of finite numbers; give such vectors")
        if (self.lower > self.upper).any():
            i = int(np.argmax(self.lower > self.upper))
            raise ValueError(
                f"lower bound {i} is {self.lower[i]:g}, above the upper bound {self.upper[i]:g}; swap them"
            )


def bounds_around(base: BaseMap, estimate: Estimate, prior: Parameters) -> Bounds:
    """Box around the description: 0.2 to 3 times each mass, centres near those of the description, matching inertias.

    The bounds of a coefficient are three times its size in `coefficient_sizes`.
    """
    start, _ = feasible_prior(base, prior)
    reach = 3 * coefficient_sizes(base, estimate.value, start.values, estimate.std)
    lower, upper = np.where(positive(start), 0.0, -reach), reach
    body = inertial(start)
    boxes = np.array([_box(x) for x in start.bodies()]).reshape(-1, 2, 10)
    lower[body], upper[body] = boxes[:, 0].ravel(), boxes[:, 1].ravel()
    return Bounds(lower, upper)


def check_box(box: Bounds, base: BaseMap) -> None:
    """Check that a box has the standard parameters of a base map.

    Raises:
        OptionError: their numbers differ.
    """
    if len(box.lower) != len(base.labels):
        raise OptionError(
            f"the bounds have {len(box.lower)} parameters; give the {len(base.labels)} standard parameters of the robot"
        )


def read_bounds(path: str | Path, links: Sequence[str], default: Bounds) -> Bounds:
    """Box from a TOML file; bounds that it does not state are those of the default.

    `[link.NAME]` holds any of `mass = [lo, hi]` [kg], `first_moment = [[lo, hi], [lo, hi], [lo, hi]]` [kg.m] and
    `inertia`, six pairs Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the link's joint frame [kg.m2]. The links are those of the
    bodies in the order of their parameters.

    Raises:
        OptionError: the file cannot be read, names an unknown link or quantity, or has an invalid interval.
    """
    try:
        content = read_toml(path)
    except (OSError, UnicodeDecodeError) as fault:
        raise OptionError(f"cannot read the bounds file {path}: {fault}") from None
    except ValueError as fault:
        raise OptionError(f"the bounds file {path} is not TOML: {fault}") from None
    sections = content.get("link", {})
    if set(content) - {"link"} or not isinstance(sections, dict):
        raise OptionError(f"the bounds file {path} has {', '.join(content)}; expected only tables [link.NAME]")
    lower, upper = default.lower.copy(), default.upper.copy()
    for link, quantities in sections.items():
        if link not in links:
            close = ", ".join(get_close_matches(link, links, n=3, cutoff=0.4) or links)
            raise OptionError(f"the bounds file {path} names {link!r}, which is not a moving link; choose from {close}")
        first = 10 * list(links).index(link)
        if not isinstance(quantities, Mapping):
            raise OptionError(f"link.{link} in {path} is {quantities!r}; expected a table [link.{link}]")
        for quantity, stated in quantities.items():
            where = f"{quantity} of [link.{link}] in {path}"
            low, high = _intervals(quantity, stated, where)
            rows = np.arange(first, first + 10)[_ROWS[quantity]]
            lower[rows], upper[rows] = low, high
    return Bounds(lower, upper)


def _intervals(quantity: str, stated: Any, where: str) -> tuple[Array, Array]:
    """Lower and upper values of a quantity."""
    if quantity not in _ROWS:
        raise OptionError(f"{where} is unknown; choose from {', '.join(_ROWS)}")
    rows = range(10)[_ROWS[quantity]]
    pairs = [stated] if quantity == "mass" else stated
    wanted = "a pair [lo, hi]" if quantity == "mass" else f"{len(rows)} pairs [lo, hi]"
    if not isinstance(pairs, list) or len(pairs) != len(rows) or not all(map(_is_pair, pairs)):
        raise OptionError(f"{where} is {stated}; expected {wanted} of finite numbers")
    low, high = np.array(pairs, dtype=float).T
    if (low > high).any():
        raise OptionError(f"{where} is {stated}; expected each pair as [lo, hi] with lo <= hi")
    if quantity == "mass" and low[0] <= 0:
        raise OptionError(f"{where} is {stated}; expected masses above 0")
    return low, high


def _is_pair(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < _HUGE for x in value)
    )


def _box(body: Array) -> Array:
    """Smallest and largest parameters (2, 10) around a feasible body."""
    matrix = pseudo_inertia(body)
    mass, centre = body[0], body[1:4] / body[0]
    spread = np.linalg.eigvalsh(matrix[:3, :3] - mass * np.outer(centre, centre))[-1] / mass  # [m2]
    near = max(_NEAR, 2 * spread**0.5)
    masses = mass * np.array(_MASS)
    corners = np.multiply.outer(masses, centre + np.multiply.outer([-1, 1], np.full(3, near))).reshape(4, 3)
    far = np.abs(centre) + near + 2 * spread**0.5
    second = masses[1] * np.outer(far, far)
    largest = TO_INERTIAL @ pack(np.block([[second, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]]))
    reach = np.abs(largest[4:])
    diagonal = np.array([True, False, True, False, False, True])
    least = np.where(diagonal, 0.0, -reach)
    return np.array([[masses[0], *corners.min(0), *least], [masses[1], *corners.max(0), *reach]])
