"""Export of a model's laws as a Python file that needs only NumPy, from their own equations."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ...effects.base import FUNCTIONS, BodyLaw, TorqueLaw
from ...model import Model, torque_model
from ...robot import described_gravity
from ...types import Law
from ..report.layout import torque_units
from .bodies import Exported
from .formats import BY_ACTUATOR, among, held

_SIGNALS = ("t", "q", "v", "a", "load", "jacobian")
_VARIABLES = ("q", "v", "a", "load")  # variable of an empirical torque, by its number
_HEAD = '''"""Torque of the laws of a signid model of {name}, in addition to the rigid bodies.

    total torque = inverse dynamics of the exported URDF, without friction and armature + torque(q, v, a{arguments})
    total torque = inverse dynamics of the exported MJCF in MuJoCo + torque(q, v, a{arguments}, mjcf=True)
"""

import numpy as np
{imports}
JOINTS = {joints!r}
UNITS = {units!r}
'''
_TORQUE = '''

def torque(q, v, a{parameters}, mjcf=False):
    """Torque (n,) of the joints in the order of JOINTS, in UNITS.

    q: (n,) positions [rad or m]; v: (n,) velocities; a: (n,) accelerations{explained}
    mjcf: leave out laws that the exported MJCF holds: armature, friction and springs.
    """
    signals = {{{signals}}}
    total = np.zeros(len(JOINTS))
    for law, needs, joints, numbers, in_mjcf in LAWS:
        if not (mjcf and in_mjcf):
            given = {{key: np.asarray(signals[key], float)[..., joints] for key in needs{but}}}
            total[joints] += law(**given, **numbers{also})
    return total
'''
_EXPLAINED = {
    "t": "t: time since the start of the recording [s].",
    "load": "load: (n,) rigid-body torque of the exported URDF, without armature [N.m or N].",
    "jacobian": "jacobian: (3, n) of the last link's centre of mass, in world axes.",
}


def write_function(model: Model) -> Exported:
    """Write a Python file with `torque(q, v, a)`, the torque of the laws from their own equations.

    Bodies and gravity belong to the URDF and the MJCF.
    """
    robot, inside = model.robot, [law for law in held(model, "mjcf") if law.effect.name not in BY_ACTUATOR]
    written = [(law, code) for law in torque_model(model).laws if (code := _code_of(law)) is not None]
    more = [key for key in _EXPLAINED if any(key in code.signals for _, code in written)]
    used = {name for _, code in written for name in code.functions}
    keyword = {"t": "t=0.0", "load": "load", "jacobian": "jacobian"}
    signals = [key for key in ("q", "v", "a", *more) if key != "t"]
    head = _HEAD.format(
        name=_quoted(robot.name),
        arguments="".join(f", {key}={key}" for key in more),
        imports="".join(
            f"from {module} import {', '.join(sorted(names))}\n"
            for module, names in (("numpy", used - {"norm"}), ("numpy.linalg", used & {"norm"}))
            if names
        ),
        joints=robot.joints,
        units=tuple(torque_units(robot)),
    )
    body = _TORQUE.format(
        parameters="".join(f", {part}" for part in ("*", *(keyword[key] for key in more)) if more),
        explained="".join(f"\n    {_EXPLAINED[key]}" for key in more),
        signals=", ".join(f'"{key}": {key}' for key in signals),
        but=' if key != "t"' if "t" in more else "",
        also=', **({"t": t} if "t" in needs else {})' if "t" in more else "",
    )
    acts = model.bodies().gravity.linear
    gravity = f"GRAVITY = {tuple(map(float, acts))}  # m/s2, in the frame of the base\n"
    tilted = not np.allclose(acts, described_gravity(robot), atol=1e-12)
    laws = [_entry(law, code, among(law, inside)) for law, code in written]
    table = "\n\nLAWS = [  # function, signals, joints, parameters, whether the MJCF holds it\n" + "".join(laws) + "]\n"
    return Exported(head + (gravity if tilted else "") + _functions(written) + table + body)


def _functions(written: Iterable[tuple[Law, _Code]]) -> str:
    """One function per effect."""
    found = {}
    for law, code in written:
        arguments = ", ".join((*code.signals, *code.numbers))
        units = ", ".join(f"{key}: {p.unit}" for key, p in law.effect.parameters.items())
        text = _quoted(f"{law.effect.equation}, [{units}]; {law.effect.source}")
        found[code.name] = f'\n\ndef {code.name}({arguments}):\n    """{text}"""\n    return {code.expression}\n'
    return "".join(found.values())


def _entry(law: Law, code: _Code, inside: bool) -> str:
    joints = law.joints[0] if len(law.joints) == 1 and law.effect.scope == "joint" else list(law.joints)
    return f"    ({code.name}, {code.signals!r}, {joints!r}, {code.numbers!r}, {inside}),\n"


def _quoted(text: str) -> str:
    """Escape text for a docstring."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


class _Code(NamedTuple):
    """A law as a Python function: name, arguments, parameters, returned expression, and functions of NumPy in it."""

    name: str
    signals: tuple[str, ...]  # subset of _SIGNALS
    numbers: dict[str, Any]
    expression: str
    functions: set[str]


def _code_of(law: Law) -> _Code | None:
    """Equation of a law; None if it is not a function of time, motion, load and Jacobian."""
    effect = law.effect
    name, equation = effect.name, effect.equation
    numbers: dict[str, Any] = {key: float(x) for key, x in effect.filled(law.parameters).items()}
    if name == "empirical":
        signal = _VARIABLES[int(numbers["variable"])]
        lists = {key + "s": [x for k, x in numbers.items() if k.startswith(f"{key}_")] for key in ("knot", "value")}
        name, numbers, equation = f"empirical_{signal}", lists, equation.replace("variable", signal)
    try:
        used = {node.id for node in ast.walk(ast.parse(equation, mode="eval")) if isinstance(node, ast.Name)}
    except SyntaxError:
        return None
    functions = used - {*numbers, *_SIGNALS}
    if not isinstance(effect, TorqueLaw | BodyLaw) or effect.memory or not functions <= {*FUNCTIONS, "norm"}:
        return None
    if effect.scope not in ("joint", "pair", "robot"):
        return None
    return _Code(name, tuple(s for s in _SIGNALS if s in used - set(numbers)), numbers, equation, functions)
