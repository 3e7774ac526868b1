"""Frozen data types of robots and recordings; `laws` defines those of laws, `parameters` those of parameters.

Shapes: N samples, n independent joints, nb bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .frozen import Frozen as Frozen, Result as Result
from .laws import (
    Coefficient as Coefficient,
    Effect as Effect,
    Law as Law,
    Shape as Shape,
    View as View,
    prismatic_unit as prismatic_unit,
)
from .parameters import (
    INERTIAL as INERTIAL,
    INERTIAL_UNITS as INERTIAL_UNITS,
    TWO_SIDED as TWO_SIDED,
    Array as Array,
    BaseMap as BaseMap,
    Estimate as Estimate,
    Indices as Indices,
    Label as Label,
    Mask as Mask,
    Parameters as Parameters,
    pseudo_inertia as pseudo_inertia,
)

if TYPE_CHECKING:
    import pinocchio as pin

Progress = Callable[[str, float], None]  # current step, completed share [1]


@dataclass(frozen=True, eq=False)
class Actuators(Frozen):
    """Stated parameters of the drives of n joints; NaN where not stated.

    armature (n,) [kg.m2 or kg]; viscous_friction (n,) [N.m.s/rad]; coulomb_friction (n,) [N.m];
    torque_offset (n,) [N.m]; torque_constant (n,) [N.m/A at the joint].
    """

    armature: Array
    viscous_friction: Array
    coulomb_friction: Array
    torque_offset: Array
    torque_constant: Array


@dataclass(frozen=True, eq=False)
class Robot(Result):
    """A robot as stated by its description, over its independent joints.

    Mimic joints and joints held fixed form one affine map: model velocity = drive @ joint velocity,
    model position = drive @ joint position + rest (angles; `configuration` computes cos and sin of continuous joints).
    """

    name: str
    model: pin.Model  # all bodies; never modified
    joints: tuple[str, ...]  # n names, in the order of the file
    numbers: tuple[int, ...]  # 1-based index of each joint among the moving joints of the file
    links: tuple[str, ...]  # nb names: the link that each joint of the model moves
    drive: Array  # (nv, n) [1]
    rest: Array  # (nv,) [rad or m]
    prismatic: Mask  # (n,)
    lower: Array  # (n,) [rad or m], -inf without a limit
    upper: Array  # (n,) [rad or m], inf without a limit
    velocity_limit: Array  # (n,) [rad/s or m/s], inf without a limit
    effort_limit: Array  # (n,) [N.m or N], inf without a limit
    actuators: Actuators
    document: str  # URDF or MJCF text, xacro expanded
    kind: str  # "urdf" or "mjcf"
    path: str
    sha256: str
    notes: tuple[str, ...] = ()  # defects of the description, one sentence each
    servo: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)  # stated numbers of drives by joint
    springs: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # stated (stiffness, rest) by joint
    registers: Mapping[tuple[str, str], Mapping[str, float]] = field(default_factory=dict)  # by recording file, joint

    def index(self, joint: str) -> int:
        """Index of a joint by name; ValueError if there is none."""
        return self.joints.index(joint)


class ServoSamples(NamedTuple):
    """Further signals of drives that follow commanded positions; NaN for missing values, None without a column."""

    dq_des: Array | None = None  # (N, n) [rad/s or m/s] commanded velocity
    tau_ff: Array | None = None  # (N, n) [N.m or N] feed-forward torque
    on: Array | None = None  # (N, n) [1] 1 while the drive holds, else 0
    pwm: Array | None = None  # (N, n) [1] duty, -1 to 1
    volt: Array | None = None  # (N, n) [V] supply
    temp: Array | None = None  # (N, n) [C]


class Samples(NamedTuple):
    """Consecutive rows of a recording; NaN for missing values, None if no joint has the column."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    tau: Array  # (N, n) [N.m or N]; NaN columns for joints without torque
    dq: Array | None  # (N, n) [rad/s or m/s]
    ddq: Array | None  # (N, n) [rad/s2 or m/s2]
    q_des: Array | None  # (N, n) [rad or m]
    origin: float = 0.0  # [s] time stamp of the start of the recording, if it is far from 0
    servo: ServoSamples | None = None  # None if no joint has any of its columns


class Table(Protocol):
    """Columns that are read in chunks, so memory does not grow with their length."""

    @property
    def columns(self) -> tuple[str, ...]: ...

    @property
    def rows(self) -> int: ...

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Read rows start..stop of the named columns, (stop - start, len(names)), NaN where empty."""
        ...


class StatedUnit(NamedTuple):
    """Unit of a column, where its file, its name or a column map states one."""

    unit: str  # "deg", or "value * 0.01 + 0.5"
    by: str  # "its name", "the column map"


class Reading(NamedTuple):
    """How a log is turned into rows."""

    text: str  # TOML
    rows: tuple[tuple[str, str, str, str], ...] = ()  # joint, columns, units, reasons, where it was drafted
    path: str = ""  # of its file, where it was found

    def with_constants(self, lines: Sequence[str]) -> Reading:
        """The reading with lines on torque constants."""
        before, title, after = self.text.partition("[torque_constant]")
        first, _, rest = after.partition("\n")
        return self._replace(text=before + "\n".join([f"{title or '[torque_constant]'}{first}", *lines, rest]))


@dataclass(frozen=True, eq=False)
class Recording(Result):
    """Positions and torques of n joints over time, read in chunks from a table."""

    joints: tuple[str, ...]  # n names: joints with a position column, in the robot's order
    table: Table
    columns: Mapping[str, tuple[str, ...]]  # "t" (1), "q", "tau", "dq", ..., of ServoSamples (n each, "" if absent)
    torque_per_unit: Array  # (n,) [N.m/A where a current is recorded, else 1]; 1 where unknown
    signed: Mask  # (n,) False where only the absolute value is recorded
    path: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()
    scaled: Mask | None = None  # (n,) False where the torque constant of a current is unknown; None: all known
    flags: tuple[str, ...] = ()  # uncertain column assignments, one sentence each
    units: Mapping[str, StatedUnit] = field(default_factory=dict)  # by column; for others that of `Samples` is assumed
    reading: Reading | None = None  # that was found or drafted; None where columns have names of recordings, or a map
    static: bool = False  # whether each row is a posture at rest

    def __len__(self) -> int:
        return self.table.rows

    @property
    def servo(self) -> tuple[bool, ...]:
        """Servo joints (n,): those with a commanded position and without torque and current."""
        absent = ("",) * len(self.joints)
        desired, torque = (self.columns.get(key) or absent for key in ("q_des", "tau"))
        return tuple(bool(q) and not tau for q, tau in zip(desired, torque, strict=True))

    def read(self, start: int = 0, stop: int | None = None, *, servo: bool = True) -> Samples:
        """Read rows start..stop of the file; torques in N.m or N. Unless `servo`, columns of ServoSamples are left."""
        stop = len(self) if stop is None else min(stop, len(self))
        left = () if servo else ServoSamples._fields
        names = [c for key, group in self.columns.items() for c in group if c and key not in left]
        values = dict(zip(names, self.table.read(names, start, stop).T, strict=True))

        def signal(key: str) -> Array | None:
            group = self.columns.get(key, ())
            if not any(group) or key in left:
                return None
            absent = np.full(stop - start, np.nan)
            return np.column_stack([values.get(c, absent) for c in group])

        q, tau = signal("q"), signal("tau")
        assert q is not None, "a recording has positions by construction"
        tau = np.full_like(q, np.nan) if tau is None else tau * self.torque_per_unit
        t, more = values[self.columns["t"][0]], ServoSamples(*map(signal, ServoSamples._fields))
        seen = more if any(each is not None for each in more) else None
        return Samples(t, q, tau, signal("dq"), signal("ddq"), signal("q_des"), servo=seen)


class Input(NamedTuple):
    """An input file of a result."""

    path: str
    sha256: str
    role: str = ""  # "recording, learned from"


@dataclass(frozen=True, eq=False)
class Trajectory(Frozen):
    """A desired motion of n joints at N instants."""

    joints: tuple[str, ...]
    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]
