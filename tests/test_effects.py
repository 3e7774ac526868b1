"""Every effect obeys the contract, and the contract catches what it must."""

import numpy as np
import pytest
from contract import faults

from signid.effects import EFFECTS
from signid.effects.armature import Armature
from signid.effects.base import Effect
from signid.effects.coulomb_friction import CoulombFriction
from signid.effects.torque_offset import TorqueOffset
from signid.effects.viscous_friction import ViscousFriction
from signid.errors import OptionError
from signid.types import Coefficient


@pytest.mark.parametrize("effect", list(EFFECTS), ids=lambda e: e.name)
def test_effect_obeys(effect: Effect) -> None:
    assert list(faults(effect)) == []


def planted() -> dict[str, Effect]:
    """Effects that are wrong in one way each."""

    def wrong(base: type[Effect], **changes: object) -> Effect:
        return type("Wrong", (base,), {"__doc__": "Wrong.", **changes})()

    return {
        "factor of two": wrong(ViscousFriction, columns=lambda self, x: [2 * x.v]),
        "sign": wrong(ViscousFriction, columns=lambda self, x: [-x.v], equation="-coefficient * v"),
        "equation": wrong(CoulombFriction, equation="level * v"),
        "reversal denied": wrong(CoulombFriction, reverses=False),
        "reversal claimed": wrong(TorqueOffset, reverses=True),
        "claims to dissipate": wrong(TorqueOffset, dissipative=True),
        "no source": wrong(TorqueOffset, source=""),
        "no example": wrong(TorqueOffset, example={}, parameters={"offset": Coefficient("N.m")}),
        "shape": wrong(TorqueOffset, columns=lambda self, x: [np.ones_like(x.q), np.ones_like(x.q)]),
        "not finite": wrong(TorqueOffset, columns=lambda self, x: [np.full_like(x.q, np.nan)]),
        "body twice": wrong(Armature, reshape=twice),
        "inverse": wrong(Armature, physical=lambda self, c, shape: {"inertia": 2 * c[0]}),
    }


def twice(self: Effect, model: object, row: int, body: int, inertia: float) -> None:
    model.armature[row] += 2 * inertia  # type: ignore[attr-defined]


@pytest.mark.parametrize("fault", planted())
def test_planted_error_is_caught(fault: str) -> None:
    assert list(faults(planted()[fault]))


def test_unknown_effects_are_named() -> None:
    with pytest.raises(OptionError, match="no effect named 'stiction'; choose from viscous_friction"):
        EFFECTS["stiction"]


def test_units_at_a_prismatic_joint() -> None:
    assert Coefficient("N.m.s/rad").unit_at(True) == "N.s/m"
    assert Coefficient("kg.m2").unit_at(True) == "kg"
