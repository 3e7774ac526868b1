"""The types that travel along the pipeline: frozen, their arrays read-only, their labels beside them.

Shapes: N samples, n joints that move by themselves, nb bodies. Parameters have a file of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from .arrays import Array as Array, Frozen as Frozen, Indices as Indices, Mask as Mask
from .parameters import (
    INERTIAL as INERTIAL,
    INERTIAL_UNITS as INERTIAL_UNITS,
    TWO_SIDED as TWO_SIDED,
    BaseMap as BaseMap,
    Estimate as Estimate,
    Label as Label,
    Parameters as Parameters,
    pseudo_inertia as pseudo_inertia,
)

if TYPE_CHECKING:
    import pinocchio as pin

Progress = Callable[[str, float], None]  # what is being done, share of it that is done [1]


@dataclass(frozen=True, eq=False)
class Actuators(Frozen):
    """What is stated about the drives of the n joints; NaN where nothing is stated.

    armature (n,) [kg.m2 or kg]; viscous_friction (n,) [N.m.s/rad]; coulomb_friction (n,) [N.m];
    torque_offset (n,) [N.m]; torque_constant (n,) [N.m/A at the joint].
    """

    armature: Array
    viscous_friction: Array
    coulomb_friction: Array
    torque_offset: Array
    torque_constant: Array


@dataclass(frozen=True, eq=False)
class Robot(Frozen):
    """A robot as its description states it, over the joints that move by themselves.

    Mimic joints and joints held fixed are one affine map: model velocity = drive @ joint velocity,
    model position = drive @ joint position + rest (angles; `configuration` makes cos and sin of continuous joints).
    """

    name: str
    model: pin.Model  # all bodies; never written to
    joints: tuple[str, ...]  # n names, in the order of the file
    numbers: tuple[int, ...]  # 1-based index of each among the moving joints of the whole file
    links: tuple[str, ...]  # nb names: the link that each joint of the model carries
    drive: Array  # (nv, n) [1]
    rest: Array  # (nv,) [rad or m]
    prismatic: Mask  # (n,)
    lower: Array  # (n,) [rad or m], -inf where none
    upper: Array  # (n,) [rad or m], inf where none
    velocity_limit: Array  # (n,) [rad/s or m/s], inf where none
    effort_limit: Array  # (n,) [N.m or N], inf where none
    actuators: Actuators
    document: str  # URDF or MJCF text, xacro expanded
    kind: str  # "urdf" or "mjcf"
    path: str
    sha256: str
    notes: tuple[str, ...] = ()  # what the description lacks, a sentence each

    def index(self, joint: str) -> int:
        """Column of the joint of that name; raises ValueError when there is none."""
        return self.joints.index(joint)


class Samples(NamedTuple):
    """Consecutive rows of a recording; NaN where a value is missing, None where no joint has the column."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    tau: Array  # (N, n) [N.m or N]; NaN columns where a joint has no torque
    dq: Array | None  # (N, n) [rad/s or m/s]
    ddq: Array | None  # (N, n) [rad/s2 or m/s2]
    q_des: Array | None  # (N, n) [rad or m]


class Table(Protocol):
    """Columns that can be read piece by piece, so that memory does not grow with their length."""

    @property
    def columns(self) -> tuple[str, ...]: ...

    @property
    def rows(self) -> int: ...

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop of the columns named, (stop - start, len(names)), NaN where empty."""
        ...


@dataclass(frozen=True, eq=False)
class Recording(Frozen):
    """Positions and torques of n joints over time; read piece by piece from its table."""

    joints: tuple[str, ...]  # n names, those with a position column, in the robot's order
    table: Table
    columns: Mapping[str, tuple[str, ...]]  # "t" (1), "q", "tau", "dq", "ddq", "q_des" (n each, "" where absent)
    torque_per_unit: Array  # (n,) [N.m/A where a current is recorded, else 1]; 1 where it is not known
    signed: Mask  # (n,) False where only the absolute value is known
    path: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()
    scaled: Mask | None = None  # (n,) False where the torque constant of a current is not known; None: all are
    flags: tuple[str, ...] = ()  # what is doubtful about its columns, a sentence each

    def __len__(self) -> int:
        return self.table.rows

    def read(self, start: int = 0, stop: int | None = None) -> Samples:
        """Rows start..stop, as they stand in the file, torques in N.m or N."""
        stop = len(self) if stop is None else min(stop, len(self))
        names = [c for group in self.columns.values() for c in group if c]
        values = dict(zip(names, self.table.read(names, start, stop).T, strict=True))

        def signal(key: str) -> Array | None:
            group = self.columns.get(key, ())
            if not any(group):
                return None
            absent = np.full(stop - start, np.nan)
            return np.column_stack([values.get(c, absent) for c in group])

        q, tau = signal("q"), signal("tau")
        assert q is not None, "a recording has positions by construction"
        tau = np.full_like(q, np.nan) if tau is None else tau * self.torque_per_unit
        return Samples(values[self.columns["t"][0]], q, tau, signal("dq"), signal("ddq"), signal("q_des"))


class Input(NamedTuple):
    """A file that a result was made from."""

    path: str
    sha256: str
    role: str = ""  # "recording, learned from"


@dataclass(frozen=True, eq=False)
class Trajectory(Frozen):
    """A motion that is asked for, at N instants of n joints."""

    joints: tuple[str, ...]
    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]


def prismatic_unit(unit: str) -> str:
    """The unit that stands at a prismatic joint where `unit` stands at a revolute one."""
    return unit.replace("kg.m2", "kg").replace("N.m", "N").replace("rad", "m")


@dataclass(frozen=True)
class Coefficient:
    """A number the torque is linear in: a column of the regressor."""

    unit: str
    positive: bool = False
    same: bool = False  # its unit at a prismatic joint too: an angle, or a body's inertia

    def unit_at(self, prismatic: bool) -> str:
        """The unit at a joint: N for N.m, m for rad, kg for kg.m2 where it is prismatic."""
        return prismatic_unit(self.unit) if prismatic and not self.same else self.unit


@dataclass(frozen=True)
class Shape:
    """A number the torque is not linear in: tried on a grid, then polished.

    `grid` counts in rms `speed`, `travel`, rms `torque`, `duration` of the joint, or in the unit itself.
    """

    unit: str
    grid: tuple[float, ...]
    of: str | None = None

    def unit_at(self, prismatic: bool) -> str:
        """The unit at a joint, as of a coefficient."""
        return prismatic_unit(self.unit) if prismatic else self.unit


class View(Protocol):
    """The m joints a law acts on, at one moment or along a motion: arrays (..., m).

    Leading axes are samples (identification) or trial values (simulation); a law does not care.
    """

    joints: tuple[int, ...]
    dt: float  # [s]
    whole: Any  # the Motion or the moment of simulation this is a view of: jacobian, regressor

    @property
    def t(self) -> Array: ...  # (..., 1) [s]
    @property
    def q(self) -> Array: ...  # (..., m) [rad or m]
    @property
    def v(self) -> Array: ...  # (..., m) [rad/s or m/s]
    @property
    def a(self) -> Array: ...  # (..., m) [rad/s2 or m/s2]
    @property
    def load(self) -> Array: ...  # (..., m) rigid-body torque [N.m or N]
    @property
    def direction(self) -> Array: ...  # (..., m) of motion, in [-1, 1]; unknown at rest [1]
    @property
    def inertia(self) -> Array: ...  # (..., m) diagonal of the mass matrix [kg.m2 or kg]
    @property
    def torque(self) -> Array: ...  # (..., m) motor torque that the model predicts [N.m or N]
    @property
    def recorded(self) -> Array: ...  # (..., m) motor torque as measured [N.m or N]
    def __getitem__(self, i: Any) -> View: ...  # some of the leading axis


@dataclass(frozen=True)
class Law:
    """An effect at its joints, with numbers: in a model all of them, as a hypothesis only its shape."""

    effect: Any  # effects.base.Effect
    joints: tuple[int, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
