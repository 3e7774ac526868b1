"""Torque ripple: periodic torque from motor poles and gear teeth."""

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw, amplitude_phase, sine_cosine


class TorqueRipple(TorqueLaw):
    """Sine with many periods per revolution of the joint, independent of speed."""

    name, equation = "torque_ripple", "amplitude * sin(frequency * q + phase)"
    source = "Tuttle, Seering, IEEE Trans. Robotics and Automation 12(3), 1996, pages 368-374"
    typical = "1 to 5 % of the rated torque; periods per revolution: pole pairs times gear ratio"
    parameters = {
        "amplitude": Coefficient("N.m"),
        "phase": Coefficient("rad", same=True),
        "frequency": Shape("1/rad", tuple(np.arange(4, 30, 0.25).tolist())),
    }
    example = {"amplitude": 2.0, "phase": 0.5, "frequency": 12.1}
    approximate = True
    coefficients, physical = sine_cosine, amplitude_phase

    def possible(self, x: View, frequency: float) -> bool:
        """Whether the travel exceeds one period; over less, the law resembles any smooth function of position."""
        return bool(frequency * np.ptp(x.q) > 2 * np.pi)

    def columns(self, x: View, frequency: float) -> list[Array]:
        return [np.sin(frequency * x.q), np.cos(frequency * x.q)]


PLUGIN = TorqueRipple()
