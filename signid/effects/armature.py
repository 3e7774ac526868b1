"""Armature: rotor inertia reflected through the gear."""

from typing import Any

from ..types import Array, Coefficient, View
from .base import BodyLaw


class Armature(BodyLaw):
    """Gear ratio squared times the rotor inertia; often larger than the inertia of the link."""

    name, equation = "armature", "inertia * a"
    source = "Featherstone, Rigid Body Dynamics Algorithms, 2008, section 9.6"
    typical = "0.01 to 0.4 kg.m2 (TX40), 0.3 to 6 (UR10E)"
    parameters = {"inertia": Coefficient("kg.m2", positive=True)}
    example = {"inertia": 0.3}
    twins = ("link_inertia",)

    def columns(self, x: View) -> list[Array]:
        return [x.a]

    def reshape(self, model: Any, row: int, body: int, inertia: float) -> None:
        model.armature[row] += inertia


PLUGIN = Armature()
