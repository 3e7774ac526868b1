"""Export of inverse dynamics as C99 without dependencies, loops, branches on data or memory of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator

from ....model import Model
from ....types import Robot
from ....version import __version__
from ...report.layout import torque_units
from ..beyond import Exported, c_comment
from .program import Function, Program, program_of, statements

_WORDS = {
    "add": "{0} + {1}",
    "subtract": "{0} - {1}",
    "multiply": "{0} * {1}",
    "divide": "{0} / {1}",
    "negate": "-{0}",
    "greater": "({0} > {1}) ? 1.0 : 0.0",
    "where": "({0} != 0.0) ? {1} : {2}",
    "sign": "(double)(({0} > 0.0) - ({0} < 0.0))",
    "abs": "fabs({0})",
    "arctan": "atan({0})",
    "arctan2": "atan2({0}, {1})",
    "minimum": "fmin({0}, {1})",
    "maximum": "fmax({0}, {1})",
    "power": "pow({0}, {1})",
    **{name: name + "({0})" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")},
}


def write_c(model: Model, stem: str | None = None, *, mass_matrix: bool = True) -> Exported:
    """Write inverse dynamics, gravity, laws and the mass matrix as C99 functions.

    The text is the source; `beside` holds the header and a test program, by the ends of their names (".h", "_test.c").
    Functions are straight-line code over constants; they read and write only the arrays that they are given.

    Args:
        model: rigid bodies and laws.
        stem: name of the files without ".c"; None: the robot's name as an identifier.
        mass_matrix: whether the mass matrix is written.

    Raises:
        RobotError: a joint is neither revolute nor prismatic.
    """
    program, robot = program_of(model, mass_matrix), model.robot
    name, n = identifier(robot.name), len(robot.joints)
    stem = name if stem is None else stem
    head = f"/* Dynamics of {c_comment(robot.name)}, written by signid {__version__}. "
    body = "".join(_definition(program, function, name, n) for function in program.functions)
    source = f'{head}See {stem}.h. */\n#include "{stem}.h"\n\n#include <math.h>\n{body}'
    header = f"{head}C99, no dependencies but math.h (-lm). */\n{_header(robot, program, name)}"
    return Exported(source, program.notes, {".h": header, "_test.c": head + "*/\n" + _test(program, name, stem, n)})


def identifier(name: str) -> str:
    """A name as an identifier of C: letters, digits and underscores."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "robot"
    return f"robot_{plain}" if plain[0].isdigit() else plain


def _signature(function: Function, name: str, n: int) -> str:
    given = (f"const double {key}[{n}]" for key in function.arguments)
    return f"void {name}_{function.name}({', '.join(given)}, double {function.result}[{len(function.outputs)}])"


def _definition(program: Program, function: Function, name: str, n: int) -> str:
    lines, outputs = statements(program, function, _WORDS, str, "    const double {} = {};")
    read = "\n".join([*lines, *outputs])
    unused = [f"    (void){key};" for key in function.arguments if f"{key}[" not in read]
    results = [f"    {function.result}[{k}] = {x};" for k, x in enumerate(outputs)]
    return f"\n{_signature(function, name, n)}\n{{\n" + "\n".join([*unused, *lines, *results]) + "\n}\n"


def _header(robot: Robot, program: Program, name: str) -> str:
    guard, n = f"{name.upper()}_DYNAMICS_H", len(robot.joints)
    comment = [
        "Arrays are in this order of joints (index, name, unit of position, unit of torque):",
        *(f"  {k}  {line}" for k, line in enumerate(_joints(robot))),
        "q: positions, v: velocities [per s], a: accelerations [per s2]; a = 0 compensates gravity and friction.",
        "At rest (v = 0) dry friction is 0. Outputs may not overlap inputs.",
        *(f"Note: {note}." for note in program.notes),
    ]
    declared = [f"/* {function.meaning} */\n{_signature(function, name, n)};" for function in program.functions]
    return "\n".join(
        [
            f"#ifndef {guard}",
            f"#define {guard}\n",
            "/*",
            *(f" * {c_comment(line) if not line.startswith(' ') else line}" for line in comment),
            " */",
            f"#define {name.upper()}_JOINTS {n}\n",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif\n",
            "\n\n".join(declared),
            "\n#ifdef __cplusplus",
            "}",
            "#endif\n",
            "#endif",
            "",
        ]
    )


def _joints(robot: Robot) -> Iterator[str]:
    for joint, prismatic, unit in zip(robot.joints, robot.prismatic, torque_units(robot), strict=True):
        yield f"{c_comment(joint)}  {'m' if prismatic else 'rad'}  {unit}"


_TEST = """/* Reads lines of q, v and a from standard input; without any, uses one motion. */
#include "STEM.h"

#include <stdio.h>

static void show(const char *name, const double *x, int n)
{
    printf("%s", name);
    for (int k = 0; k < n; k++) {
        printf(" %.17g", x[k]);
    }
    printf("\\n");
}

static int scan(double *x, int n)
{
    int k = 0;
    while (k < n && scanf("%lf", x + k) == 1) {
        k++;
    }
    return k == n;
}

static void all(const double *q, const double *v, const double *a)
{
    double out[SIZE];
CALLS}

int main(void)
{
    double q[COUNT], v[COUNT], a[COUNT];
    int lines = 0;
    for (; scan(q, COUNT) && scan(v, COUNT) && scan(a, COUNT); lines++) {
        all(q, v, a);
    }
    if (lines == 0) {
        for (int j = 0; j < COUNT; j++) {
            q[j] = 0.1 * (j + 1);
            v[j] = 0.2;
            a[j] = -0.3;
        }
        all(q, v, a);
    }
    return 0;
}
"""


def _test(program: Program, name: str, stem: str, n: int) -> str:
    """A program that reads q, v, a from standard input and prints the outputs of every function."""
    calls = "".join(
        f'    {name}_{f.name}({", ".join(f.arguments)}, out);\n    show("{f.name}", out, {len(f.outputs)});\n'
        for f in program.functions
    )
    size = max(len(f.outputs) for f in program.functions)
    filled = {"STEM": stem, "SIZE": str(size), "CALLS": calls, "COUNT": str(n)}
    return re.sub("|".join(filled), lambda found: filled[found[0]], _TEST)
