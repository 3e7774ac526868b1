"""Export of inverse dynamics as Python over an array namespace: NumPy, jax.numpy or torch, which differentiate it."""

from __future__ import annotations

from ....errors import one_line
from ....model import Model
from ....version import __version__
from ...report.layout import torque_units
from ..bodies import Exported, fixed_note, in_docstring
from .graph import UNARY
from .program import FIXED_JOINTS_NOTE, Function, Language, Program, program_of, statements

_ARRAYS = {
    "add": "{0} + {1}",
    "subtract": "{0} - {1}",
    "multiply": "{0} * {1}",
    "divide": "{0} / {1}",
    "negate": "-{0}",
    "greater": "1.0 * ({0} > {1})",
    "where": "xp.where({0} != 0, {1}, {2})",
    "power": "{0} ** {1}",
    "minimum": "xp.clip({0}, None, {1})",
    "maximum": "xp.clip({0}, {1}, None)",
    **{name: f"xp.{name}({{0}})" for name in UNARY},
    "arctan2": "xp.arctan2({0}, {1})",
}
_PYTHON = Language(_ARRAYS, lambda x: x.replace("[", "[..., "), "    {} = {}", lambda text: f"    # {one_line(text)}")
_ARRAY_HEAD = '''"""Dynamics of {name}, written by signid {version}, over an array namespace.

Every function takes arrays (..., {n}) in the order of JOINTS [rad or m, per s, per s2]; torques are in UNITS.
xp: numpy (default), jax.numpy or torch; derivatives hold wherever dry friction is smooth.
"""

import numpy

JOINTS = {joints!r}
UNITS = {units!r}
'''


def write_arrays(model: Model) -> Exported:
    """Write inverse dynamics, gravity, laws and the mass matrix as Python functions over an array namespace."""
    program, robot = program_of(model), model.robot
    head = _ARRAY_HEAD.format(
        name=in_docstring(robot.name),
        version=__version__,
        n=len(robot.joints),
        joints=tuple(robot.joints),
        units=tuple(torque_units(robot)),
    )
    functions = "".join(_definition(program, function, len(robot.joints)) for function in program.functions)
    return Exported(head + functions, tuple(fixed_note(robot, FIXED_JOINTS_NOTE)))


def _definition(program: Program, function: Function, n: int) -> str:
    lines, outputs = statements(program, function, _PYTHON)
    first = function.arguments[0]
    rows = ", ".join(f"{x} + zero" for x in outputs)
    shape = f".reshape((*{first}.shape[:-1], {n}, {n}))" if len(outputs) != n else ""
    return (
        f"\n\ndef {function.name}({', '.join(function.arguments)}, xp=numpy):\n"
        f'    """{function.meaning[:1].upper()}{function.meaning[1:]}."""\n'
        f"    zero = 0.0 * {first}[..., 0]\n" + "\n".join([*lines, f"    return xp.stack([{rows}], -1){shape}"]) + "\n"
    )
