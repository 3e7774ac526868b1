"""The arm of Pennese and Vulcano: masses, printed table of coefficients, and its wrong entries.

The table has 13 coefficients; ten combinations of them are identifiable from torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signid.types import BaseMap

from .truth import Array

G, L2, L3, D2 = 9.81, 0.3, 0.2, 0.09  # gravity [m/s2], lengths [m]
COUNT = 13
PUBLISHED = (0.0113, 0.3040, 0.0005, 0.0702, 0.0003, 0.0675, 0.3741, 0.0702, 0.0354, 0.203, 4.9663, 2.2073, 2.2072)
DIGITS = (4, 4, 4, 4, 4, 4, 4, 4, 4, 3, 4, 4, 4)  # printed decimals
IDENTIFIABLE = (
    ("pi1 + pi3 + pi5", ((0, 1), (2, 1), (4, 1))),
    ("pi2 - pi3", ((1, 1), (2, -1))),
    ("pi4 - pi5", ((3, 1), (4, -1))),
    *((f"pi{k}", ((k - 1, 1),)) for k in (6, 7, 8, 9, 10)),
    ("pi11 + pi13", ((10, 1), (12, 1))),
    ("pi12", ((11, 1),)),
)
QUOTED = {  # errors of the paper's four estimates, quoted because the estimates are not in the data
    "the printed table, as printed": (2.9102, 3.7181, 2.9274, 3.1812),
    "the right 13": (1.541, 0.139, 1.481, 0.817),
    "the ten combinations": (0.0569, 0.0718, 0.0406, 0.0501),
}


@dataclass(frozen=True)
class Arm:
    """Masses [kg], centres of mass along the frames of Denavit and Hartenberg [m], inertias about them [kg.m2]."""

    masses: tuple[float, float] = (1.125, 0.75)  # links 2 and 3
    centre_2x: float = -0.15
    centre_2z: float = -0.06
    centre_3x: float = -0.1
    inertia_1y: float = 4.167e-3
    inertia_2: tuple[float, float, float] = (4.167e-4 * 1.125, 7.708e-3 * 1.125, 7.708e-3 * 1.125)
    inertia_3: tuple[float, float, float] = (4.167e-4 * 0.75, 3.542e-3 * 0.75, 3.542e-3 * 0.75)


@dataclass(frozen=True)
class Entry:
    """Printed and correct value of one coefficient."""

    name: str
    published: float
    right: float
    slipped: float  # value with mirrored centres of mass
    digits: int

    @property
    def wrong(self) -> bool:
        """Whether the printed number differs from the correct one in its last digit."""
        return abs(self.published - self.right) > 0.51 * 10.0**-self.digits

    @property
    def why(self) -> str:
        """Cause of a wrong entry, if known."""
        if not self.wrong:
            return ""
        if abs(self.published - self.slipped) <= 0.51 * 10.0**-self.digits:
            return "L + d for L - d"
        ten = abs(self.published - 10 * self.slipped) <= 0.51 * 10.0**-self.digits
        return "L + d for L - d, and the decimal point" if ten else "unknown"


def coefficients(arm: Arm, side: int = 1) -> Array:
    """The 13 coefficients [kg.m2, N.m] of an arm; side -1 mirrors the centres of mass.

    Args:
        arm: masses, centres and inertias.
        side: 1 or -1.
    """
    (m2, m3), (xx2, yy2, zz2), (xx3, yy3, zz3) = arm.masses, arm.inertia_2, arm.inertia_3
    r2, r3 = L2 + side * arm.centre_2x, L3 + side * arm.centre_3x  # from the joint to the centre
    offset = D2 - side * arm.centre_2z
    return np.array(
        [
            arm.inertia_1y + m2 * offset**2 + m3 * D2**2,
            m2 * r2**2 + m3 * L2**2 + yy2,
            xx2,
            yy3 + m3 * r3**2,
            xx3,
            m3 * r3 * L2,
            zz2 + m2 * r2**2 + zz3 + m3 * (L2**2 + r3**2),
            m3 * r3**2 + zz3,
            m2 * r2 * offset + m3 * L2 * D2,
            m3 * r3 * D2,
            G * m2 * r2,
            G * m3 * r3,
            G * m3 * L2,
        ]
    )


def identifiable(thirteen: Sequence[float] | Array) -> Array:
    """Identifiable combinations (10,) [kg.m2, N.m] of all coefficients (13,) [kg.m2, N.m]."""
    return np.array([sum(side * thirteen[k] for k, side in terms) for _, terms in IDENTIFIABLE])


def entries() -> list[Entry]:
    """Entries of the printed and the correct table."""
    right, slipped = coefficients(Arm()), coefficients(Arm(), side=-1)
    rows = zip(PUBLISHED, right.tolist(), slipped.tolist(), DIGITS, strict=True)
    return [Entry(f"pi{k}", *row) for k, row in enumerate(rows, 1)]


def standard(arm: Arm) -> Array:
    """Standard parameters (30,) [kg, kg.m, kg.m2] of robots/3r; unidentifiable ones of link 1 are zero."""
    bodies = [np.zeros(10), np.zeros(10), np.zeros(10)]
    bodies[0][9] = arm.inertia_1y  # its axis of rotation is z there
    places = ((L2 + arm.centre_2x, 0.0, arm.centre_2z - D2), (L3 + arm.centre_3x, 0.0, 0.0))
    for k, (mass, centre, inertia) in enumerate(zip(arm.masses, places, (arm.inertia_2, arm.inertia_3), strict=True)):
        c = np.array(centre)
        about = np.diag(inertia) + mass * (c @ c * np.eye(3) - np.outer(c, c))
        bodies[k + 1][:] = [mass, *(mass * c), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    return np.concatenate(bodies)


def arm_map(base: BaseMap) -> Array:
    """Map (10, b) [units of the combinations over units of base] from base parameters of robots/3r to combinations.

    Raises:
        ArithmeticError: the base parameters belong to another arm.
    """
    values, wanted = _drawn(base)
    solution = np.linalg.lstsq(values, wanted, rcond=None)[0]
    if np.abs(values @ solution - wanted).max() > 1e-9:
        raise ArithmeticError("the base parameters belong to another arm")
    return np.asarray(solution.T)


def ten_of(base: BaseMap, value: Array, information: Array) -> Array:
    """Combinations (10,) [kg.m2, N.m] by weighted least squares, restricted to arms of this kind.

    Args:
        base: base map of robots/3r.
        value: estimate (b,) [units of base].
        information: information matrix (b, b) [1 over the square of these units].

    Raises:
        ArithmeticError: the base parameters belong to another arm.
    """
    _, size, rows = np.linalg.svd(_drawn(base)[0])
    such = rows[: np.sum(size > 1e-9 * size[0])].T  # (b, k) basis of the base parameters of these arms
    simple = such @ np.linalg.solve(such.T @ information @ such, such.T @ information @ value)
    return np.asarray(arm_map(base) @ simple)


def _drawn(base: BaseMap) -> tuple[Array, Array]:
    """Base parameters (60, b) and combinations (60, 10) of random arms; each is linear in the other."""
    rng, found = np.random.default_rng(0), []
    for _ in range(60):
        masses, a, b = rng.uniform(0.5, 2.0, 2), rng.uniform(1e-3, 1e-2, 3), rng.uniform(1e-3, 1e-2, 3)
        arm = Arm(tuple(masses), *rng.uniform(-0.2, 0.2, 3), rng.uniform(1e-3, 1e-2), tuple(a), tuple(b))
        found.append((base.combination @ standard(arm), identifiable(coefficients(arm))))
    values, wanted = (np.array(part) for part in zip(*found, strict=True))
    return values, wanted


def pendulum_map(base: BaseMap) -> Array:
    """Map (2, b) [N.m and kg.m2 over units of base] from base parameters of robots/1r to m g d and I + m d2."""
    rows = np.zeros((2, base.rank))
    rows[0, base.expressions.index("mz_1")], rows[1, base.expressions.index("Iyy_1")] = -G, 1.0
    return rows


TRUE_1R = np.array([24.525, 1.67085])  # N.m, kg.m2
TRUE_3R = identifiable(coefficients(Arm()))  # kg.m2, N.m
