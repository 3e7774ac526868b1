"""Result of a servo identification: numbers of each drive with intervals, what is identifiable, roll-outs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ...estimation.repeats import VaryingNumber
from ...frozen import Frozen, Result
from ...model import Model
from ...servos import Servo
from ...types import Array, Input, Robot
from ..given import Bounds, Prior
from ..search.choice import Candidate
from ..zeros import JointZero

BY_INERTIALS = "inertials of the description"  # what the scale of torque is known by
BY_GAIN = "stated kp"
BY_NOTHING = "none"


class LoggedRows(NamedTuple):
    """Rows of one recording; its stamps are taken as they are."""

    path: str
    period: float  # [s] median
    content_rate: float  # [Hz] of the rows that were neither interpolated nor repeated


@dataclass(frozen=True)
class ServoNumber:
    """One number of a drive. `value` is None where the recordings do not identify it; `sentence` then says why."""

    name: str  # one of servos.SERVO_NUMBERS, or "damping" or "lag"
    unit: str
    value: float | None
    std: float | None = None  # None where the number is stated or not identifiable
    stated: bool = False  # known before, not estimated
    sentence: str = ""
    prior: Prior | None = None  # that `std` contains
    bounds: Bounds | None = None
    at_bound: bool = False  # whether `value` is one of its bounds, and not measured
    below: float | None = None  # [its unit] bound of a number that is not identifiable
    above: float | None = None  # [its unit] the same

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval; None without a standard deviation."""
        if self.value is None or self.std is None:
            return None
        return self.value - 1.96 * self.std, self.value + 1.96 * self.std


@dataclass(frozen=True)
class ServoJoint:
    """Drive of one joint as identified."""

    joint: str
    law: str  # one of servos.DRIVE_LAWS
    law_probability: float | None  # posterior among the laws that were tried; None where the law is stated
    laws: Mapping[str, float]  # posterior of each law that was tried; empty where it is stated
    numbers: Mapping[str, ServoNumber]  # by name; kp, damping, delay, lag, armature, coulomb_friction, ...
    saturated_share: float  # share of samples in which the drive gives its limit [1]
    known_load_share: float  # share of the rms torque of the joint that its known masses explain [1]
    not_identifiable: tuple[str, ...]  # one sentence each
    equal: tuple[str, ...] = ()  # other joints with which it shares all numbers but the torque offset


@dataclass(frozen=True)
class ServoScale:
    """Source of the common scale of torque and mass."""

    known_by: str  # BY_INERTIALS, BY_GAIN or BY_NOTHING
    sentence: str
    alternatives: tuple[str, ...] = ()  # "if the firmware's kp is 20 as stated, FL_thigh is 1.4 times as heavy ..."
    mass_ratios: tuple[float, ...] = ()  # [1] of true masses to those of the description, if the stated gains are true
    gain: str = ""  # what --known says for these: "kp=20", or "kp" of several


@dataclass(frozen=True, eq=False)
class ServoRollOut(Frozen):
    """Closed-loop simulation from commands alone, n joints [rad or m]; NaN for joints without commands."""

    joints: tuple[str, ...]  # n
    units: tuple[str, ...]  # n, "rad" or "m"
    whole_rms: Array  # (n,) [rad or m] over whole recordings
    one_second_rms: Array  # (n,) [rad or m] restarted from the measured state every second
    nominal_whole_rms: Array  # (n,) [rad or m] of the stated numbers, or of q = q_des without or where these diverge
    nominal_one_second_rms: Array  # (n,) [rad or m] the same every second
    nominal: str  # "stated numbers" or "q = q_des"
    held_out: bool  # whether the recordings took no part in the fit
    tracking_rms: Array  # (n,) [rad or m] of command - position, on the same rows


@dataclass(frozen=True, eq=False)
class ServoTrace(Frozen):
    """One held-out recording and its simulation, N rows on a uniform grid, n joints."""

    path: str
    joints: tuple[str, ...]
    t: Array  # (N,) [s]
    command: Array  # (N, n) [rad or m]
    measured: Array  # (N, n) [rad or m]
    simulated: Array  # (N, n) [rad or m] whole recording from commands alone
    nominal: Array  # (N, n) [rad or m] the same with the stated numbers, or q = q_des
    one_second: Array | None = None  # (N, n) [rad or m] simulated, restarted from the measured state every second


@dataclass(frozen=True, eq=False)
class FrictionModel(Frozen):
    """A named friction model, fitted in the place of the friction of the identified drives; n joints."""

    name: str
    terms: str  # what it has
    numbers: Mapping[str, Mapping[str, ServoNumber]]  # by joint and name
    servos: Mapping[str, Servo]  # by joint, fitted to the training rows
    mean_absolute: (
        Array  # (n,) [rad or m] error of held-out recordings, whole, from commands alone; NaN without a drive
    )
    rms: Array  # (n,) [rad or m]
    log_bayes_factor: float  # [1] over the first model, of the windows of the training rows
    probability: float  # [1] among the named models, limited by differences of windows; NaN of the identification
    seconds: float  # processor time [s]


@dataclass(frozen=True, eq=False)
class ServoIdentification(Result):
    """Drives of a robot, identified from commands and positions. `flags` say what not to rely on."""

    robot: Robot
    model: Model  # with `servos`
    servos: Mapping[str, Servo]  # by joint, as they simulate; unidentifiable numbers keep the value used there
    joints: tuple[ServoJoint, ...]
    scale: ServoScale
    rollout: ServoRollOut
    traces: tuple[ServoTrace, ...]  # of the held-out recordings
    inputs: tuple[Input, ...]  # the recordings with their roles
    flags: tuple[str, ...]  # exit 3
    notes: tuple[str, ...]
    seed: int
    refit: bool = False  # whether the model was fitted again to all rows; `rollout` and `traces` are of the fit before
    logs: tuple[LoggedRows, ...] = ()  # rows of the recordings
    far: tuple[str, ...] = ()  # joints whose held-out motion is predicted far worse than that of the training data
    zeros: tuple[JointZero, ...] = ()  # signs and zeros of positions, where gravity was compared with them
    start: Candidate | None = None  # drives of the search and their free numbers, by the training rows
    friction_models: tuple[FrictionModel, ...] = ()  # where they were compared
    varies: tuple[VaryingNumber, ...] = ()  # numbers that differ between recordings by more than their intervals
