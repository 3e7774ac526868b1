"""The box in which standard parameters are searched: around the description, or as a TOML file states it."""

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
from ..feasible.packing import TO_INERTIAL, pack
from ..feasible.prior import coefficient_sizes, feasible_prior, inertial, positive

_MASS = (0.2, 3.0)  # times the mass stated
_HUGE = 1e100
_NEAR = 0.05  # [m] that a centre of mass may be off, or twice the radius of gyration where that is more
_ROWS = {"mass": slice(0, 1), "first_moment": slice(1, 4), "inertia": slice(4, 10)}


@dataclass(frozen=True, eq=False)
class Bounds(Frozen):
    """Least and largest values of the p standard parameters.

    Raises:
        ValueError: when a bound is not finite or a lower one is above its upper.
    """

    lower: Array  # (p,) [unit of each]
    upper: Array  # (p,) [unit of each]

    def __post_init__(self) -> None:
        """Arrays are copied and checked."""
        super().__post_init__()
        if self.lower.shape != self.upper.shape or not np.isfinite([self.lower, self.upper]).all():
            raise ValueError("bounds are not two vectors of one length of finite numbers; give a box")
        if (self.lower > self.upper).any():
            i = int(np.argmax(self.lower > self.upper))
            raise ValueError(f"lower bound {i} is {self.lower[i]:g}, above the upper one {self.upper[i]:g}; swap them")


def bounds_around(base: BaseMap, estimate: Estimate, prior: Parameters) -> Bounds:
    """A box around the description: 0.2 to 3 times each mass, each centre near the one stated, inertias to match.

    Coefficients reach to three times what the base parameters could need of them.

    Args:
        base: which combinations of the standard parameters the torque shows.
        estimate: base parameters, for the coefficients.
        prior: standard parameters of the description.

    Raises:
        ValueError: when the prior does not have the labels of the base map.
    """
    start, _ = feasible_prior(base, prior)
    reach = 3 * coefficient_sizes(base, estimate.value, start.values, estimate.std)
    lower, upper = np.where(positive(start), 0.0, -reach), reach
    body = inertial(start)
    boxes = np.array([_box(x) for x in start.bodies()]).reshape(-1, 2, 10)
    lower[body], upper[body] = boxes[:, 0].ravel(), boxes[:, 1].ravel()
    return Bounds(lower, upper)


def check_box(box: Bounds, base: BaseMap) -> None:
    """Whether a box is over the standard parameters of a base map.

    Raises:
        OptionError: it is not.
    """
    if len(box.lower) != len(base.labels):
        raise OptionError(
            f"the bounds are over {len(box.lower)} parameters; expected the {len(base.labels)} of the map"
        )


def read_bounds(path: str | Path, links: Sequence[str], default: Bounds) -> Bounds:
    """The box of a TOML file; what it does not state is as in the default.

    `[link.NAME]` holds any of `mass = [lo, hi]` [kg], `first_moment = [[lo, hi], [lo, hi], [lo, hi]]` [kg.m] and
    `inertia`, six pairs Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the link's joint frame [kg.m2].

    Args:
        path: of the file.
        links: names of the bodies in the order of their parameters.
        default: a box over all standard parameters, ten per body first.

    Raises:
        OptionError: when the file cannot be read, names what does not exist, or states what is no interval.
    """
    try:
        content = read_toml(path)
    except (OSError, UnicodeDecodeError) as fault:
        raise OptionError(f"cannot read the bounds file {path}: {fault}") from None
    except ValueError as fault:
        raise OptionError(f"the bounds file {path} is not TOML: {fault}") from None
    sections = content.get("link", {})
    if set(content) - {"link"} or not isinstance(sections, dict):
        raise OptionError(f"the bounds file {path} has {', '.join(content)}; expected tables [link.NAME] and no more")
    lower, upper = default.lower.copy(), default.upper.copy()
    for link, quantities in sections.items():
        first = 10 * _index(link, links, path)
        if not isinstance(quantities, Mapping):
            raise OptionError(f"link.{link} in {path} is {quantities!r}; expected a table [link.{link}]")
        for quantity, stated in quantities.items():
            where = f"{quantity} of [link.{link}] in {path}"
            low, high = _intervals(quantity, stated, where)
            rows = np.arange(first, first + 10)[_ROWS[quantity]]
            lower[rows], upper[rows] = low, high
    return Bounds(lower, upper)


def _index(link: str, links: Sequence[str], path: str | Path) -> int:
    if link not in links:
        close = get_close_matches(link, links, n=3, cutoff=0.4) or links
        raise OptionError(f"the bounds file {path} names a link {link!r} that does not move; choose {', '.join(close)}")
    return list(links).index(link)


def _intervals(quantity: str, stated: Any, where: str) -> tuple[Array, Array]:
    """Lower and upper values of a quantity."""
    if quantity not in _ROWS:
        raise OptionError(f"{where} is not known; choose from {', '.join(_ROWS)}")
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
    """(2, 10) least and largest values around a possible body."""
    matrix = pseudo_inertia(body)
    mass, centre = body[0], body[1:4] / body[0]
    spread = np.linalg.eigvalsh(matrix[:3, :3] - mass * np.outer(centre, centre))[-1] / mass  # gyration, squared
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
