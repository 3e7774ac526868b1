"""Laws with one error each, and the contract's message for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from signid.effects import EFFECTS
from signid.effects.base import BodyLaw, Effect, TorqueLaw
from signid.types import Coefficient, Shape

EQUATION = "its equation and its code differ"
BODIES = "its columns and the reshaped bodies differ"
DEFLECTION = "its deflection is not what `hold` balances"
SHIFTED = "its columns are not the torque of its deflection"
RECORD = "its columns are not the change of the recording"
INVERSE = "coefficients and physical are no inverses"
CARD = "its card is incomplete"
EXAMPLE = "its example does not give every parameter"
SHAPE = "its columns have another shape, or are not finite"
DRIVES = "it does not dissipate"
REVERSES = "its columns jump with the direction of motion, and `reverses` denies it, or the other way round"
LEADING = "it looks at the leading axis"
REVOLUTE = "its units do not fit its equation at a revolute joint"
PRISMATIC = "its units do not fit its equation at a prismatic joint"
KIND = "it is of no kind, or of two"
ACTING = "its columns are not what the record has more than the torque that acts"


def wrong(name: str, **changes: Any) -> Effect:
    """An effect with some of its class replaced; a function is given the right method first."""
    right = type(EFFECTS[name])

    def over(key: str, change: Any) -> Any:
        if not callable(change) or isinstance(change, type):
            return change
        own: Callable[..., Any] = getattr(right, key)
        return lambda self, *args, **kwargs: change(lambda *a, **k: own(self, *a, **k), *args, **kwargs)

    changed = {key: over(key, change) for key, change in changes.items()}
    made: Effect = type("Wrong", (right,), {"__doc__": "Wrong.", **changed})()
    return made


def negated(own: Any, *args: Any, **shape: float) -> Any:
    return [-column for column in own(*args, **shape)]


def twice(own: Any, *args: Any, **shape: float) -> Any:
    return [2 * column for column in own(*args, **shape)]


def doubled(key: str) -> Any:
    """The right method with one parameter twice as large."""
    return lambda own, *args, **p: own(*args, **{**p, key: 2 * p[key]})


class Both(TorqueLaw, BodyLaw):
    """Effect of two kinds."""


PLANTED: dict[str, tuple[Effect, str]] = {
    "viscous friction twice": (wrong("viscous_friction", columns=twice), EQUATION),
    "Coulomb friction drives": (wrong("coulomb_friction", columns=negated, equation="-level * sign(v)"), DRIVES),
    "drift claims to dissipate": (
        wrong("friction_drift", dissipative=True, example={"change": -2.0, "time_constant": 4.0}),
        DRIVES,
    ),
    "equation of another law": (wrong("coulomb_friction", equation="level * v"), EQUATION),
    "reversal denied": (wrong("load_friction", reverses=False), REVERSES),
    "reversal claimed": (wrong("torque_offset", reverses=True), REVERSES),
    "drag twice": (wrong("fluid_drag", columns=twice), EQUATION),
    "drag of the signed square": (
        wrong("fluid_drag", columns=lambda own, x: [np.einsum("nij,ni->nj", x.whole.jacobian, w2(x))]),
        EQUATION,
    ),
    "half the presliding distance": (
        wrong("presliding_friction", advance=lambda own, z, x, distance: own(z, x, distance=distance / 2)),
        EQUATION,
    ),
    "unbounded memory": (
        wrong("presliding_friction", advance=lambda own, z, x, distance: z + x.dt * x.v / distance),
        EQUATION,
    ),
    "exponent of Stribeck": (
        wrong("stribeck_friction", columns=lambda own, x, velocity: [np.exp(-abs(x.v / velocity)) * x.direction]),
        EQUATION,
    ),
    "load friction without a size": (
        wrong("load_friction", columns=lambda own, x: [x.load * x.direction], dissipative=False),
        EQUATION,
    ),
    "sign of a phase": (
        wrong("torque_ripple", physical=lambda own, c, shape: {**own(c, shape), "phase": -own(c, shape)["phase"]}),
        INVERSE,
    ),
    "sign of the rest": (
        wrong("spring", coefficients=lambda own, p: [p["stiffness"], p["stiffness"] * p["rest"]]),
        INVERSE,
    ),
    "sign of the rest, both ways": (
        wrong(
            "spring",
            coefficients=lambda own, p: [p["stiffness"], p["stiffness"] * p["rest"]],
            physical=lambda own, c, shape: {"stiffness": c[0], "rest": c[1] / c[0]},
        ),
        EQUATION,
    ),
    "binomial of the cable": (
        wrong("cable_torque", coefficients=lambda own, p: [*own(p)[:2], -own(p)[2], own(p)[3]]),
        EQUATION,
    ),
    "armature twice in the columns": (wrong("armature", columns=twice), EQUATION),
    "armature twice in the bodies": (wrong("armature", reshape=doubled("inertia")), BODIES),
    "payload twice": (wrong("payload", reshape=doubled("mass")), BODIES),
    "payload at another link": (
        wrong("payload", reshape=lambda own, model, row, body, **p: own(model, row, body - 1, **p)),
        BODIES,
    ),
    "axes of a first moment exchanged": (
        wrong("link_inertia", columns=lambda own, x: [own(x)[k] for k in (0, 2, 1, *range(3, 10))]),
        EQUATION,
    ),
    "tilted the other way": (wrong("base_tilt", columns=negated), EQUATION),
    "gravity turned the other way": (
        wrong("base_tilt", reshape=lambda own, model, row, body, x, y: own(model, row, body, x=-x, y=-y)),
        BODIES,
    ),
    "spring twice as stiff": (wrong("joint_elasticity", hold=doubled("stiffness")), EQUATION),
    "soft gear bends the other way": (wrong("joint_elasticity", deflection=negated), DEFLECTION),
    "soft gear without its resonance": (
        wrong("joint_elasticity", deflection=lambda own, x, stiffness: [-x.load / stiffness]),
        DEFLECTION,
    ),
    "gap twice as wide on the way": (wrong("backlash", deflection=doubled("gap")), DEFLECTION),
    "half the gap in the stops": (wrong("backlash", hold=lambda own, x, gap: own(x, gap=gap / 2)), EQUATION),
    "gap crossed at once": (
        wrong("backlash", deflection=lambda own, x, gap: [-gap / 2 * np.sign(x.load)]),
        DEFLECTION,
    ),
    "shift of another joint": (
        wrong("backlash", columns=lambda own, x, gap: [-column for column in own(x, gap=gap)]),
        SHIFTED,
    ),
    "sign of an encoder offset": (wrong("encoder_offset", columns=negated), RECORD),
    "recorded before the offset": (
        wrong("encoder_offset", recorded_q=lambda own, x, offset: x.q - offset),
        EQUATION,
    ),
    "early, not late": (
        wrong("time_delay", recorded_torque=lambda own, x, delay: own(x, delay=-delay)),
        EQUATION,
    ),
    "lag twice as long": (wrong("torque_lag", recorded_torque=doubled("time_constant")), EQUATION),
    "gain twice": (wrong("torque_gain", recorded_torque=doubled("error")), EQUATION),
    "gain twice in the columns": (wrong("torque_gain", columns=twice), RECORD),
    "sign kept": (wrong("torque_sign", recorded_torque=lambda own, x: x.torque), EQUATION),
    "swapped along the samples": (
        wrong("channel_swap", recorded_torque=lambda own, x: x.torque[::-1]),
        EQUATION,
    ),
    "saturated on one side": (
        wrong("torque_saturation", applied_torque=lambda own, x, limit: np.minimum(x.torque, limit)),
        EQUATION,
    ),
    "saturation the wrong way round": (wrong("torque_saturation", columns=negated), ACTING),
    "contact twice": (wrong("external_contact", columns=twice), EQUATION),
    "contact without an end": (
        wrong("external_contact", columns=lambda own, x, start, end: own(x, start=start, end=1e9)),
        EQUATION,
    ),
    "wrong partner": (
        wrong("joint_coupling", columns=lambda own, x: [x.a, *own(x)[1:]]),
        EQUATION,
    ),
    "mean over the leading axis": (
        wrong("quadratic_friction", columns=lambda own, x: [x.v * abs(x.v) + 1e-9 * x.v[..., :1].mean(0)]),
        LEADING,
    ),
    "unit of another power": (
        wrong("quadratic_friction", parameters={"coefficient": Coefficient("N.m.s/rad", positive=True)}),
        REVOLUTE,
    ),
    "unit wrong where prismatic": (
        wrong("spring", parameters={"stiffness": Coefficient("N.m"), "rest": Coefficient("rad")}),
        PRISMATIC,
    ),
    "a frequency in radians": (
        wrong(
            "torque_ripple",
            parameters={
                **{key: p for key, p in EFFECTS["torque_ripple"].parameters.items() if key != "frequency"},
                "frequency": Shape("rad", (1.0,)),
            },
        ),
        PRISMATIC,
    ),
    "no source": (wrong("torque_offset", source=""), CARD),
    "no magnitudes": (wrong("torque_offset", typical=""), CARD),
    "no example": (wrong("torque_offset", example={}), EXAMPLE),
    "one column too many": (wrong("viscous_friction", columns=lambda own, x: [x.v, x.v]), SHAPE),
    "not a number": (wrong("torque_offset", columns=lambda own, x: [np.full_like(x.q, np.nan)]), SHAPE),
    "of two kinds": (Both(), KIND),
}


def w2(x: Any) -> Any:
    """Velocity components of the tip times their absolute values: wrong, since the speed is not used."""
    w = np.einsum("nij,nj->ni", x.whole.jacobian, x.v)
    return w * np.abs(w)
