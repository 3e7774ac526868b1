"""Export of inverse dynamics as code: C99 without dependencies, and Python over NumPy, jax.numpy or torch.

C has no loops, branches on data or memory of its own; the array namespaces of Python differentiate theirs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill

from ....effects.naming import law_name
from ....errors import one_line
from ....model import Model, torque_model
from ....version import __version__
from ...report.layout import torque_units
from ..bodies import Exported, c_comment, fixed_note, in_docstring
from ..formats import writable
from .graph import UNARY
from .observer import OBSERVER_TERMS, observer_code, observer_terms
from .program import FIXED_JOINTS_NOTE, Function, Program, program_of


@dataclass(frozen=True)
class Language:
    """Formats of a programming language."""

    words: Mapping[str, str]  # of each operation, in its operands
    variable: Callable[[str], str]  # text of an input such as "q[0]"
    line: str  # in the name and the expression
    comment: Callable[[str], str]  # line with a text


def statements(program: Program, function: Function, language: Language) -> tuple[list[str], list[str]]:
    """Lines that compute a function, one per operation, with comments, and the names or numbers of its outputs."""
    graph, names, section = program.graph, dict[int, str](), ""
    lines: list[str] = []
    for number in graph.used(function.outputs):
        operation, *inner = graph.nodes[number]
        if operation == "variable":
            names[number] = language.variable(inner[0])
        elif operation == "constant":
            names[number] = f"({inner[0]!r})" if inner[0] < 0 else repr(inner[0])
        else:
            if graph.sections[number] != section:
                section = graph.sections[number]
                lines.append(language.comment(section))
            names[number] = f"t{number}"
            words = language.words[operation].format(*(names[k] for k in inner))
            lines.append(language.line.format(names[number], words))
    return lines, [names[output.number] for output in function.outputs]


_ARITHMETIC = {
    "add": "{0} + {1}",
    "subtract": "{0} - {1}",
    "multiply": "{0} * {1}",
    "divide": "{0} / {1}",
    "negate": "-{0}",
}
_C_OPERATIONS = {
    **_ARITHMETIC,
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


_C = Language(_C_OPERATIONS, str, "    const double {} = {};", lambda text: f"    /* {c_comment(text)} */")
_ARGUMENT_SIZES = {"width": None, "payload": 10}  # of arguments that have no number for each joint; None: a number
TWIST_ROWS = tuple(f"{kind} velocity {axis}" for kind in ("linear", "angular") for axis in "xyz")  # rows of a Jacobian


def write_c(
    model: Model, stem: str | None = None, *, digest: str = "", further: Collection[str] = (), link: str | None = None
) -> Exported:
    """Write inverse dynamics, gravity, laws, the mass matrix and friction by a desired velocity as C99 functions.

    The text is the source; `beside` holds the header and a test program, by the ends of their names (".h", "_test.c").
    Functions are straight-line code over constants; they read and write only the arrays that they are given.

    digest: SHA-256 of the model, for the header; `further` as `functions` of `export`.
    """
    program, robot = program_of(model, tracking=True, further=further, link=link), model.robot
    name, n = identifier(robot.name), len(robot.joints)
    stem = name if stem is None else stem
    head = f"/* Dynamics of {c_comment(robot.name)}, written by signid {__version__}. "
    body = "".join(_definition(program, function, name, robot.joints) for function in program.functions)
    observed = tested = ""  # in the header and the test program
    if "observer" in further:
        observed, steps, tested = observer_code(model, name)
        terms = observer_terms(model)
        body += _definition(terms, terms.functions[0], name, robot.joints, "static ") + steps
    source = f'{head}See {stem}.h. */\n#include "{stem}.h"\n\n#include <math.h>\n{body}'
    declared = _header(model, program, name, digest, observed)
    header = f"{head}C99, no dependencies but math.h (-lm). */\n{declared}"
    calls = "".join(
        f'    {name}_{f.name}({", ".join(f.arguments)}, out);\n    show("{f.name}", out, {len(f.outputs)});\n'
        for f in program.functions
    )
    used = {key for f in program.functions for key in f.arguments}
    arguments = "".join(text for key, text in _ARGUMENTS.items() if key in used)
    calls = arguments.replace("NAME", name).replace("COUNT", str(n)) + calls + tested
    filled = {"STEM": stem, "SIZE": str(max(len(f.outputs) for f in program.functions)), "COUNT": str(n)}
    test = re.sub("|".join(filled), lambda match: filled[match[0]], _C_TEST).replace("CALLS\n", calls)
    return Exported(source, tuple(fixed_note(robot, FIXED_JOINTS_NOTE)), {".h": header, "_test.c": f"{head}*/\n{test}"})


def identifier(name: str) -> str:
    """A name as an identifier of C: letters, digits and underscores."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "robot"
    return f"robot_{plain}" if plain[0].isdigit() else plain


def _signature(function: Function, name: str, n: int) -> str:
    sizes = {key: _ARGUMENT_SIZES.get(key, n) for key in function.arguments}
    parameters = (f"double {key}" if size is None else f"const double {key}[{size}]" for key, size in sizes.items())
    return f"void {name}_{function.name}({', '.join(parameters)}, double {function.result}[{len(function.outputs)}])"


def _definition(program: Program, function: Function, name: str, joints: Sequence[str], linkage: str = "") -> str:
    lines, outputs = statements(program, function, _C)
    nodes = [program.graph.nodes[number] for number in program.graph.used(function.outputs)]
    read = {node[1].partition("[")[0] for node in nodes if node[0] == "variable"}
    unused = [f"    (void){key};" for key in function.arguments if key not in read]
    rows = {"mass": joints, "jacobian": TWIST_ROWS, "terms": OBSERVER_TERMS}.get(function.result)  # of a matrix
    labels = list(joints) if rows is None else [f"{row}, {joint}" for row in rows for joint in joints]
    results = [
        f"    {function.result}[{k}] = {x}; /* {c_comment(label)} */"
        for k, (x, label) in enumerate(zip(outputs, labels, strict=True))
    ]
    signature = _signature(function, name, len(joints))
    return f"\n{linkage}{signature}\n{{\n" + "\n".join([*unused, *lines, *results]) + "\n}\n"


def _header(model: Model, program: Program, name: str, digest: str, observer: str) -> str:
    robot = model.robot
    joints = zip(robot.joints, robot.prismatic, torque_units(robot), strict=True)
    guard, n = f"{name.upper()}_DYNAMICS_H", len(robot.joints)
    formulas = list[str]()
    for law in filter(writable, torque_model(model).laws):
        numbers = ", ".join(f"{key} = {x:.6g}" for key, x in law.effect.filled(law.parameters).items())
        formulas.append(f"  {c_comment(f'{law_name(law, robot)}: {law.effect.equation}; {numbers}')}")
    comment = [
        "Arrays are in this order of joints (index, name, unit of position, unit of torque):",
        *(f"  {k}  {c_comment(x)}  {'m' if slides else 'rad'}  {unit}" for k, (x, slides, unit) in enumerate(joints)),
        "q: positions, v: velocities [per s], a: accelerations [per s2]; a = 0 compensates gravity and friction.",
        "At rest (v = 0) dry friction is 0. Outputs may not overlap inputs.",
        "tau = M(q) a + h(q, v) + laws(q, v, 0), with M the mass matrix, rotors (armature) included, and h Coriolis,",
        "centrifugal and gravity torque of the bodies; laws that depend on load, the torque of the bodies, act at a.",
        "Laws:",
        *(formulas or ["  none"]),
        f"Gravity in the frame of the base [m/s2]: {' '.join(f'{x:.10g}' for x in model.robot.model.gravity.linear)}",
        *([f"SHA-256 of the model.json of this model: {digest}"] if digest else []),
    ]
    declared = [
        f"/* {fill(c_comment(function.meaning), 100, subsequent_indent='   ')} */\n{_signature(function, name, n)};"
        for function in program.functions
    ]
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
            "\n\n".join(declared) + observer.rstrip(),
            "\n#ifdef __cplusplus",
            "}",
            "#endif\n",
            "#endif",
            "",
        ]
    )


_ARGUMENTS = {  # arguments beside q, v and a
    "width": "    const double width = 0.1;\n",
    "payload": "    const double payload[10] = {2.0, 0.1, 0.04, 0.16, 0.02, -0.002, 0.03, -0.008, -0.003, 0.04};\n",
    "v_desired": """    double v_desired[COUNT];
    for (int j = 0; j < COUNT; j++) {
        v_desired[j] = 0.5 * v[j];
    }
""",
    "tau": """    double tau[COUNT];
    NAME_inverse_dynamics(q, v, a, tau);
""",
}
_C_TEST = """/* Reads lines of q, v and a from standard input; without any, uses one motion. */
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
CALLS
}

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


_ARRAYS = {
    **_ARITHMETIC,
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
    program, robot, n = program_of(model), model.robot, len(model.robot.joints)
    text = _ARRAY_HEAD.format(
        name=in_docstring(robot.name),
        version=__version__,
        n=n,
        joints=tuple(robot.joints),
        units=tuple(torque_units(robot)),
    )
    for function in program.functions:
        lines, outputs = statements(program, function, _PYTHON)
        first = function.arguments[0]
        rows = ", ".join(f"{x} + zero" for x in outputs)
        shape = f".reshape((*{first}.shape[:-1], {n}, {n}))" if len(outputs) != n else ""
        text += (
            f"\n\ndef {function.name}({', '.join(function.arguments)}, xp=numpy):\n"
            f'    """{function.meaning[:1].upper()}{function.meaning[1:]}."""\n'
            f"    zero = 0.0 * {first}[..., 0]\n"
        )
        text += "\n".join([*lines, f"    return xp.stack([{rows}], -1){shape}"]) + "\n"
    return Exported(text, tuple(fixed_note(robot, FIXED_JOINTS_NOTE)))
