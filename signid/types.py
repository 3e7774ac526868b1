"""Frozen data types of parameters, robots, recordings and laws.

Shapes: N samples, n independent joints, nb bodies, p standard parameters, b base parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from .frozen import Frozen as Frozen, Result as Result

if TYPE_CHECKING:
    import pinocchio as pin

Numbers = Mapping[str, float]
Progress = Callable[[str, float], None]  # current step, completed share [1]
Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
INERTIAL = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # Pinocchio's order
INERTIAL_UNITS = ("kg", *("kg.m",) * 3, *("kg.m2",) * 6)
TWO_SIDED = 1.96  # half-width of a 95 % confidence interval of a normal distribution [standard deviations]


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


def prismatic_unit(unit: str) -> str:
    """Unit at a prismatic joint that corresponds to `unit` at a revolute one."""
    return unit.replace("kg.m2", "kg").replace("N.m", "N").replace("rad", "m")


@dataclass(frozen=True)
class Coefficient:
    """A parameter that enters the torque linearly: a column of the regressor."""

    unit: str
    positive: bool = False
    same: bool = False  # same unit at prismatic joints: an angle, or a body's inertia

    def unit_at(self, prismatic: bool) -> str:
        """Unit at a joint: N for N.m, m for rad, kg for kg.m2 at prismatic joints."""
        return prismatic_unit(self.unit) if prismatic and not self.same else self.unit


@dataclass(frozen=True)
class Shape:
    """A parameter that enters the torque nonlinearly: searched on a grid, then refined.

    `grid` is relative to `of`: the rms `speed`, `travel`, rms `torque` or `duration` of the joint; None: absolute.
    """

    unit: str
    grid: tuple[float, ...]
    of: str | None = None
    positive: bool = True  # whether zero and negative values are impossible

    def unit_at(self, prismatic: bool) -> str:
        """Unit at a joint, converted as for a coefficient."""
        return prismatic_unit(self.unit) if prismatic else self.unit


class View(Protocol):
    """State of the m joints of a law, at one instant or along a motion: arrays (..., m).

    Leading axes are samples (identification) or trial values (simulation).
    """

    @property
    def joints(self) -> tuple[int, ...]: ...
    @property
    def dt(self) -> float: ...  # [s]
    @property
    def whole(self) -> Any: ...  # the underlying Motion or simulation state: jacobian, regressor
    @property
    def t(self) -> Array: ...  # (..., 1) [s]
    @property
    def origin(self) -> float: ...  # [s] time stamp of the start of the recording, if it is far from 0
    @property
    def q(self) -> Array: ...  # (..., m) [rad or m]
    @property
    def v(self) -> Array: ...  # (..., m) [rad/s or m/s]
    @property
    def a(self) -> Array: ...  # (..., m) [rad/s2 or m/s2]
    @property
    def load(self) -> Array: ...  # (..., m) rigid-body torque [N.m or N]
    @property
    def direction(self) -> Array: ...  # (..., m) of motion, in [-1, 1], between at rest [1]
    @property
    def inertia(self) -> Array: ...  # (..., m) diagonal of the mass matrix [kg.m2 or kg]
    @property
    def torque(self) -> Array: ...  # (..., m) motor torque that the model predicts [N.m or N]
    @property
    def recorded(self) -> Array: ...  # (..., m) motor torque as measured [N.m or N]
    def __getitem__(self, i: Any) -> View: ...  # indexes the leading axis


class Effect:
    """Interface of an effect, with its defaults.

    Recorded torque = rigid-body torque + sum over k of columns[k] * coefficient[k].
    """

    name: ClassVar[str] = ""
    equation: ClassVar[str] = ""  # executable text in its parameters, t, q, v, a, load, torque, inertia and `FUNCTIONS`
    source: ClassVar[str] = ""
    typical: ClassVar[str] = ""  # typical magnitudes
    parameters: ClassVar[Mapping[str, Coefficient | Shape]] = {}
    regressors: ClassVar[Mapping[str, Coefficient]] = {}  # coefficient of each column; {}: the linear parameters
    example: ClassVar[Numbers] = {}  # typical values: demonstration, injection, contract test
    headline: ClassVar[str] = ""  # a finding in words, fields: {joint}, {partner}, {KEY}; "": name, joint, main number
    optional: ClassVar[tuple[str, ...]] = ()  # parameters that default to a function of the others
    scope: ClassVar[str] = "joint"
    """joint: one joint, its own row | pair: two joints | link: one joint, all rows | tip: the same, of the last joint
    | robot: all joints | any: all joints together, or one."""
    dissipative: ClassVar[bool] = False  # columns * v, summed over the joints, >= 0
    reverses: ClassVar[bool] = False  # discontinuous at velocity reversals
    twins: ClassVar[tuple[str, ...]] = ()  # similar effects: distinguishable by special motions only, or by none
    contains: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    """Simpler effects contained in this one: factor from their coefficient to each parameter."""
    changes: ClassVar[tuple[str, ...]] = ()  # effects that this one modifies; one of them must be at the joint
    common: ClassVar[float | None] = None  # prior frequency [1]; None: 1 if `signid.effects` lists it, else 0.1
    usual: ClassVar[bool] = False  # present at nearly every joint
    approximate: ClassVar[bool] = False  # never matches a real robot exactly
    memory: ClassVar[bool] = False  # has a state: `begin` and `advance` of `effects.base.TorqueLaw`

    def __repr__(self) -> str:
        return f"<{self.name}>"

    def columns(self, x: View, *args: Any, **shape: Any) -> list[Array]:
        """Arrays (..., m), one per coefficient [torque per unit]; (N, n) for the scopes link and tip.

        `args`: the state (..., m) [1] of an effect with memory; `shape`: its shape parameters.
        """
        raise NotImplementedError

    def possible(self, x: View, *args: Any, **shape: Any) -> bool:
        """Whether the motion can show the effect; columns are computed only then."""
        return True

    def possible_value(self, parameters: Numbers) -> bool:
        """Whether the parameters are physically possible; searches return no others."""
        return True

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        """Candidate shapes for a motion; none if their scale is zero."""
        scale: dict[str | None, Callable[[], float]] = {
            None: lambda: 1.0,
            "speed": lambda: float(np.std(x.v)),
            "travel": lambda: float(np.ptp(x.q)),
            "torque": lambda: float(np.sqrt(np.mean(x.load**2))),
            "duration": lambda: float(np.ptp(x.t)),
        }
        free = {key: p for key, p in self.parameters.items() if isinstance(p, Shape)}
        sizes = [scale[p.of]() for p in free.values()]
        for values in product(*(np.array(p.grid) * size for p, size in zip(free.values(), sizes, strict=True))):
            if all(sizes):
                yield dict(zip(free, map(float, values), strict=True))

    def linear(self) -> dict[str, Coefficient]:
        """Coefficients among the parameters, by key."""
        return {key: p for key, p in self.parameters.items() if isinstance(p, Coefficient)}

    def coefficients(self, parameters: Numbers) -> list[float]:
        """Convert public parameters to linear coefficients; 1 for an effect without parameters."""
        complete = self.filled(parameters)
        return [complete[key] for key in self.linear()] or [1.0]

    def filled(self, parameters: Numbers) -> dict[str, float]:
        """Parameters including the optional ones."""
        return dict(parameters)

    def physical(self, coefficients: Sequence[float], shape: Numbers) -> dict[str, float]:
        """Convert linear coefficients and shape to public parameters."""
        linear = self.linear()
        return {**dict(zip(linear, map(float, coefficients[: len(linear)]), strict=True)), **shape}

    def shape(self, parameters: Numbers) -> dict[str, float]:
        """Shape parameters among the given ones."""
        shaped = [key for key, p in self.parameters.items() if isinstance(p, Shape)]
        return {key: parameters[key] for key in shaped if key in parameters}

    def meaning(self, parameters: Numbers) -> str:
        """Interpretation of the parameters for reports; "" if they need none."""
        return ""


@dataclass(frozen=True)
class Law:
    """An effect at its joints with parameters: all of them in a model, the shape only in a hypothesis."""

    effect: Effect
    joints: tuple[int, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Label:
    """Label of a standard parameter: an inertial parameter of a body, or a coefficient of a law."""

    name: str  # "Izz_2", "armature_1"
    unit: str
    body: int | None = None  # 0-based body of the model, for inertial parameters
    law: int | None = None  # index of its law
    joint: int | None = None  # column of the law's joint
    positive: bool = False  # negative values are unphysical


@dataclass(frozen=True, eq=False)
class BaseMap(Result):
    """Identifiable combinations of the standard parameters: base = combination @ standard."""

    labels: tuple[Label, ...]  # p
    independent: Indices  # (b,) leading standard parameter of each combination
    combination: Array  # (b, p) [unit of base over unit of standard]
    expressions: tuple[str, ...]  # b formulas, "Izz_2 + 0.09 m_3"
    units: tuple[str, ...]  # b
    sees: Mask  # (n, b) whether the torque of a joint depends on a base parameter
    singular_values: Array  # (p,) [1] of the scaled regressor on random states, descending
    condition: float  # condition number of the kept columns, scaled

    @property
    def rank(self) -> int:
        return len(self.independent)

    @property
    def invisible(self) -> tuple[Label, ...]:
        """Standard parameters without influence on the torque of any motion."""
        seen = np.abs(self.combination).max(0, initial=0.0) > 0
        return tuple(label for label, s in zip(self.labels, seen, strict=True) if not s)


@dataclass(frozen=True, eq=False)
class Estimate(Result):
    """Estimated base parameters and their covariance."""

    value: Array  # (b,) [units of base]
    covariance: Array  # (b, b) [units of base]; infinite variance where unidentifiable
    information: Array  # (b, b) [1/units of base] information matrix: Gram matrix weighted by the noise
    noise: Array  # (n,) [N.m or N] standard deviation of the decimated residual
    orders: tuple[int, ...]  # (n,) order of the autoregressive noise model
    method: str = "weighted least squares"
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()  # limitations of the result
    names: tuple[str, ...] = ()  # b formulas of an identification, "Izz_2 + 0.09 m_3"
    units: tuple[str, ...] = ()  # b
    spread: Array | None = None  # (b,) [units of base] standard deviation between recordings, 0: agree; None: only one

    @property
    def std(self) -> Array:
        """(b,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class Parameters(Frozen):
    """Standard parameters: ten inertial parameters per body, then the coefficients of the laws."""

    labels: tuple[Label, ...]  # p
    values: Array  # (p,) [units of the labels]

    def bodies(self) -> Array:
        """(nb, 10) inertial parameters in Pinocchio's order [kg, kg.m, kg.m2]."""
        return self.values[[i for i, label in enumerate(self.labels) if label.body is not None]].reshape(-1, 10)

    def is_feasible(self, margin: float = 1e-12) -> bool:
        """Whether all pseudo-inertias are positive definite, and friction and armature are >= 0.

        Verified by Cholesky factorisation of pseudo-inertia - margin * trace, independently of any solver.

        Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
        """
        positive = [value for label, value in zip(self.labels, self.values, strict=True) if label.positive]
        return min(positive, default=0.0) >= 0 and all(_is_positive(x, margin) for x in self.bodies())


def pseudo_inertia(inertial: Array) -> Array:
    """Pseudo-inertia (4, 4) [[S, h], [h', m]], S = tr(I)/2 - I, of ten inertial parameters.

    Args:
        inertial: (10,) in Pinocchio's order [kg, kg.m, kg.m2].

    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018, equation 8.
    """
    m, x, y, z, xx, xy, yy, xz, yz, zz = inertial
    rotational = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = np.trace(rotational) / 2 * np.eye(3) - rotational
    first = np.array([[x, y, z]])
    return np.block([[second, first.T], [first, np.array([[m]])]])


def _is_positive(inertial: Array, margin: float) -> bool:
    matrix = pseudo_inertia(inertial)
    try:
        np.linalg.cholesky(matrix - margin * np.trace(matrix) * np.eye(4))
    except np.linalg.LinAlgError:
        return False
    return True
