"""Dynamics of a model as functions of arrays of states: torque, gravity, mass matrix, simulated motion."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from ..effects.base import ActuatorLaw, RecordingLaw, TransmissionLaw
from ..effects.drive import DriveLaw
from ..effects.naming import law_name
from ..errors import OptionError, shorten
from ..robot import configuration
from ..robot.dynamics import gravity_torque, mass_matrices
from ..types import Array, Law, Result, Robot
from .motion import Motion

if TYPE_CHECKING:
    import pinocchio as pin
    from numpy.typing import ArrayLike

SIMULATION_MODULE = "..simulation.plant.plant"  # comes after every model, so it is imported when it is first used


class Simulated(NamedTuple):
    """Simulated motion of a batch (...) at K instants, of the motors."""

    q: Array  # (..., K, n) [rad or m]
    v: Array  # (..., K, n) [rad/s or m/s]
    torque: Array  # (..., K, n) of the motors [N.m or N]


class JointDynamics(Result):
    """Base class of models: functions of states of the n joints, for one row (n,) or a batch (..., n) of rows."""

    robot: Robot
    laws: tuple[Law, ...]

    @abstractmethod
    def bodies(self) -> pin.Model:
        """New pin.Model with the inertials and the changes by body laws."""

    @abstractmethod
    def inverse(self, motion: Motion) -> Array:
        """Predict the recorded torque (N, n) [N.m or N] along a recorded motion."""

    def torque(self, q: ArrayLike, v: ArrayLike = 0.0, a: ArrayLike = 0.0, t: ArrayLike = 0.0) -> Array:
        """Torque of the motors (..., n) [N.m or N]: bodies, rotors, friction and every other law of the joints.

        Laws that change commands or recorded values are left out (torque_gain, time_delay, torque_saturation, laws of
        drives). Dry friction is zero where v is zero.

        Args:
            q: positions (..., n) [rad or m], in the order of `robot.joints`.
            v: velocities (..., n) [rad/s or m/s], or one number for all joints.
            a: accelerations (..., n) [rad/s2 or m/s2], or one number for all joints.
            t: instants (...) [s], for laws of time (friction_drift, external_contact).

        Raises:
            OptionError: wrong shape, a number that is not finite, or a law that depends on the past motion.
        """
        past = [law for law in self.laws if law.effect.memory or isinstance(law.effect, TransmissionLaw)]
        if past:
            names = shorten([law_name(law, self.robot) for law in past])
            raise OptionError(
                f"torque: {names} depends on the past motion, and torque(q, v, a) is a function of one instant; "
                f'leave it out with model.without("{past[0].effect.name}"), or use model.simulate'
            )
        (q, v, a), batch = rows_of(self.robot, "torque", q=q, v=v, a=a)
        try:
            instants = np.broadcast_to(np.asarray(t, float), batch).ravel()
        except (TypeError, ValueError):
            raise OptionError(f"torque: t is not one number or an array {batch} as q is; give instants in s") from None
        beside = ActuatorLaw | DriveLaw | RecordingLaw
        acting = replace(self, laws=tuple(law for law in self.laws if not isinstance(law.effect, beside)))  # type: ignore[type-var]
        return acting.inverse(Motion(self.robot, instants, q, v, a)).reshape(*batch, len(self.robot.joints))

    def gravity(self, q: ArrayLike) -> Array:
        """Torque (..., n) [N.m or N] that holds the bodies against gravity; `torque(q)` adds springs and offsets.

        q: (..., n) [rad or m].

        Raises:
            OptionError: wrong shape, or a number that is not finite.
        """
        ([rows], batch), bodies = rows_of(self.robot, "gravity", q=q), self.bodies()
        whole = replace(self.robot, model=bodies)
        return gravity_torque(whole, configuration(whole, rows), bodies.gravity.linear).reshape(
            *batch, len(self.robot.joints)
        )

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Mass matrix (..., n, n) [kg.m2 or kg] of bodies and rotors, with the inertia of joint_coupling.

        q: (..., n) [rad or m]. Elastic joints count as rigid.

        Raises:
            OptionError: wrong shape, or a number that is not finite.
        """
        ([rows], batch), bodies = rows_of(self.robot, "mass_matrix", q=q), self.bodies()
        mass = mass_matrices(bodies, bodies.createData(), configuration(self.robot, rows), self.robot.drive)
        for law in self.laws:
            if law.effect.name == "joint_coupling":
                mass[:, list(law.joints), list(law.joints[::-1])] += law.parameters["inertia"]
        return mass.reshape(*batch, *mass.shape[1:])

    def simulate(
        self,
        t: ArrayLike,
        q: ArrayLike,
        v: ArrayLike = 0.0,
        *,
        torque: ArrayLike | None = None,
        commands: ArrayLike | None = None,
        step: float = 1e-3,
    ) -> Simulated:
        """Simulate motions from initial states under given torque, or under commands to the position drives.

        All laws act, as in `signid.simulate`; under torque those of drives do not. All rows of a batch are simulated
        together. Laws of time count from t[0].

        Args:
            t: K instants (K,) [s], ascending.
            q: initial positions (..., n) [rad or m].
            v: initial velocities (..., n) [rad/s or m/s], or one number for all joints.
            torque: torque of the motors (..., K, n) [N.m or N], linear between the instants; None: zero.
            commands: commanded positions (..., K, n) [rad or m], each held until the next, instead of torque.
            step: time step [s].

        Raises:
            OptionError: wrong shape, a number that is not finite, torque and commands at once, commands to a model
                without drives, or a simulation that cannot be made or diverges.
        """
        simulate_batch: Any = import_module(SIMULATION_MODULE, __package__).simulate_batch
        simulated: Simulated = simulate_batch(self, t, (q, v), torque, commands, step)
        return simulated

    def without(self, *effects: str) -> Self:
        """Model without its laws of these effects: `model.without("backlash")`.

        Raises:
            OptionError: the model has no such law.
        """
        known = sorted({law.effect.name for law in self.laws})
        if unknown := [name for name in effects if name not in known]:
            raise OptionError(f"without: the model has no law {unknown[0]!r}; it has {shorten(known) or 'none'}")
        return replace(self, laws=tuple(law for law in self.laws if law.effect.name not in effects))  # type: ignore[type-var]


def rows_of(robot: Robot, verb: str, **given: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
    """Signals of a batch as rows (N, n) each, and the shape (...) of the batch.

    given: arrays (..., n) [any units] by name, which are broadcast; the first has an axis of joints.

    Raises:
        OptionError: another shape, or a number that is not finite.
    """
    n, first = len(robot.joints), next(iter(given))
    signals = {name: numbers_of(verb, name, x) for name, x in given.items()}
    for name, x in signals.items():
        if x.shape[-1:] != (n,) and (x.ndim or name == first):
            raise OptionError(
                f"{verb}: {name} has the shape {x.shape}; give (..., {n}), the joints {shorten(robot.joints)} last"
            )
    try:
        whole = np.broadcast_arrays(*signals.values())
    except ValueError:
        shapes = ", ".join(f"{name} {x.shape}" for name, x in signals.items())
        raise OptionError(f"{verb}: the shapes {shapes} differ; give the same rows for all") from None
    return [x.reshape(-1, n) for x in whole], whole[0].shape[:-1]


def numbers_of(verb: str, name: str, given: ArrayLike) -> Array:
    """An argument as an array of finite numbers.

    Raises:
        OptionError: it is not; the sentence names the verb and the argument.
    """
    try:
        array = np.asarray(given).astype(float, casting="same_kind")
    except (TypeError, ValueError):
        raise OptionError(f"{verb}: {name} is no array of numbers ({type(given).__name__})") from None
    if not np.isfinite(array).all():
        place = tuple(map(int, np.argwhere(~np.isfinite(array))[0]))
        raise OptionError(f"{verb}: {name} is {array[place]}{f' at {list(place)}' * bool(place)}; give finite numbers")
    return array
