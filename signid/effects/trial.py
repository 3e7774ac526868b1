"""View of given values instead of a motion: (..., m) arrays or numbers."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any


@dataclass(slots=True, eq=False)
class Trial:
    """A View of given values; zero where none is given."""

    q: Any = 0.0  # (..., m) [rad or m]
    v: Any = 0.0  # (..., m) [rad/s or m/s]
    _: KW_ONLY
    a: Any = 0.0  # (..., m) [rad/s2 or m/s2]
    load: Any = 0.0  # (..., m) [N.m or N]
    direction: Any = 0.0  # (..., m) [1]
    inertia: Any = 0.0  # (..., m) [kg.m2 or kg]
    torque: Any = 0.0  # (..., m) [N.m or N]
    recorded: Any = 0.0  # (..., m) [N.m or N]
    t: Any = 0.0  # (..., 1) [s]
    dt: float = 0.0
    origin: float = 0.0  # [s]
    joints: tuple[int, ...] = ()
    whole: Any = None

    def __getitem__(self, i: Any) -> Trial:
        """Index the leading axis of all arrays."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return Trial(**{name: x[i] if getattr(x, "ndim", 0) else x for name, x in values.items()})
