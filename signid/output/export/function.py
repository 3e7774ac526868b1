"""Export of a model's laws as a Python file that needs only NumPy, from their own equations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...effects.base import FUNCTIONS, BodyLaw, TorqueLaw
from ...model import Model, torque_model
from ...robot import described_gravity
from ...types import Law
from ..report.layout import torque_units
from .bodies import Exported, in_docstring
from .formats import ACTUATOR_LAWS, among, equation_names, equation_numbers, held

_FUNCTION_SIGNALS = ("t", "q", "v", "a", "load", "jacobian")
_FUNCTION_HEAD = '''"""Torque of the laws of a signid model of {name}, in addition to the rigid bodies.

    total torque = inverse dynamics of the exported URDF, without friction and armature + torque(q, v, a, ...)
    total torque = inverse dynamics of the exported MJCF in MuJoCo + torque(q, v, a, ..., mjcf=True)
"""

import numpy as np
{imports}
JOINTS = {joints!r}
UNITS = {units!r}
{gravity}'''
_TORQUE_FUNCTION = '''

def torque(q, v, a, *, t=0.0, load=None, jacobian=None, mjcf=False):
    """Torque (n,) of the joints in the order of JOINTS, in UNITS.

    q: (n,) positions [rad or m]; v: (n,) velocities; a: (n,) accelerations
    t: time since the start of the recording [s].
    load: (n,) rigid-body torque of the exported URDF, without armature [N.m or N], if a law names it.
    jacobian: (3, n) of the last link's centre of mass, in world axes, if a law names it.
    mjcf: leave out laws that the exported MJCF holds at its joints: armature, friction and springs.
    """
    signals = {"q": q, "v": v, "a": a, "load": load, "jacobian": jacobian}
    total = np.zeros(len(JOINTS))
    for law, needs, joints, numbers, in_mjcf in LAWS:
        if not (mjcf and in_mjcf):
            given = {key: t if key == "t" else np.asarray(signals[key], float)[..., joints] for key in needs}
            total[joints] += law(**given, **numbers)
    return total
'''


def write_function(model: Model) -> Exported:
    """Write a Python file with `torque(q, v, a)`, the torque of the laws from their own equations.

    Bodies and gravity belong to the URDF and the MJCF.
    """
    robot, inside = model.robot, [law for law in held(model, "mjcf") if law.effect.name not in ACTUATOR_LAWS]
    written = [(law, code) for law in torque_model(model).laws if (code := _code_of(law)) is not None]
    used = {name for _, code in written for name in code.functions}
    lines = [f"from numpy.linalg import {name}\n" for name in sorted(used & {"norm"})]
    lines = [f"from numpy import {', '.join(names)}\n" for names in [sorted(used - {"norm"})] if names] + lines
    acts = model.bodies().gravity.linear
    tilted = not np.allclose(acts, described_gravity(robot), atol=1e-12)
    gravity = f"GRAVITY = {tuple(map(float, acts))}  # m/s2, in the frame of the base; use it with the URDF\n"
    head = _FUNCTION_HEAD.format(
        name=in_docstring(robot.name),
        imports="".join(lines),
        joints=robot.joints,
        units=tuple(torque_units(robot)),
        gravity=gravity if tilted else "",
    )
    table = "\n\nLAWS = [  # function, signals, joints, parameters, whether the MJCF holds it\n"
    functions = {}  # one per effect
    for law, code in written:
        arguments = ", ".join((*code.signals, *code.numbers))
        units = ", ".join(f"{key}: {p.unit}" for key, p in law.effect.parameters.items())
        text = in_docstring(f"{law.effect.equation}, [{units}]; {law.effect.source}")
        functions[code.name] = f'\n\ndef {code.name}({arguments}):\n    """{text}"""\n    return {code.expression}\n'
        at = law.joints[0] if len(law.joints) == 1 and law.effect.scope == "joint" else list(law.joints)
        table += f"    ({code.name}, {code.signals!r}, {at!r}, {code.numbers!r}, {among(law, inside)}),\n"
    return Exported(head + "".join(functions.values()) + table + "]\n" + _TORQUE_FUNCTION)


class _Code(NamedTuple):
    """A law as a Python function: name, arguments, parameters, returned expression, and functions of NumPy in it."""

    name: str
    signals: tuple[str, ...]  # subset of _FUNCTION_SIGNALS
    numbers: dict[str, Any]
    expression: str
    functions: set[str]


def _code_of(law: Law) -> _Code | None:
    """Equation of a law; None if it is not a function of time, motion, load and Jacobian."""
    effect = law.effect
    name, equation = effect.name, effect.equation
    numbers, variable = equation_numbers(law)
    if variable:
        name, equation = f"empirical_{variable}", equation.replace("variable", variable)
    used = equation_names(equation)
    if used is None or not isinstance(effect, TorqueLaw | BodyLaw) or effect.memory:
        return None
    functions = used - {*numbers, *_FUNCTION_SIGNALS}
    if not functions <= {*FUNCTIONS, "norm"} or effect.scope not in ("joint", "pair", "robot"):
        return None
    return _Code(name, tuple(s for s in _FUNCTION_SIGNALS if s in used - set(numbers)), numbers, equation, functions)
