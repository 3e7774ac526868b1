"""Functions of a model as expressions: inverse dynamics, gravity, laws, mass matrix."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ....model import Model, torque_model
from ..beyond import fixed_note, lacking
from .graph import Graph, Scalar
from .laws import inertial, law_expressions, writable
from .rigid import Bodies, Expressions, rigid_torque, rotor_torque, tree_of

MASS = (
    "mass matrix by rows, of the bodies, the armature and couplings of joints: mass_matrix(q) a + "
    "inverse_dynamics(q, v, 0) = inverse_dynamics(q, v, a) where no law depends on load or is a curve over acceleration"
)
LAWS = "torque of the laws alone: armature, friction, springs, offsets"
TWICE = (
    "; mass_matrix holds the armature, too: inverse_dynamics(q, v, a) is mass_matrix(q) a + Coriolis torque + "
    "gravity(q) + laws(q, v, 0)"
)
ACCELERATION = re.compile(r"\ba\b")  # in the equation of a law


@dataclass(frozen=True)
class Function:
    """A function of the motion: names of its arguments, and its outputs as nodes of one graph."""

    name: str
    arguments: tuple[str, ...]  # of "q", "v", "a"
    result: str
    outputs: tuple[Scalar, ...]  # (n,), or (n * n,) by rows
    meaning: str


@dataclass(frozen=True)
class Program:
    """Functions of a model over one graph, and notes on laws that they lack."""

    graph: Graph
    functions: tuple[Function, ...]
    notes: tuple[str, ...]


def program_of(model: Model, mass_matrix: bool = False) -> Program:
    """Functions of a model.

    Raises:
        RobotError: a joint is neither revolute nor prismatic.
    """
    graph, tree, n = Graph(), tree_of(model), len(model.robot.joints)
    zero = np.array([graph.constant(0.0)] * n)
    motion = {key: np.array([graph.variable(f"{key}[{j}]") for j in range(n)]) for key in ("q", "v", "a")}
    load = rigid_torque(graph, tree, motion["q"], motion["v"], motion["a"])
    laws = rotor_torque(tree, motion["a"]) + law_expressions(graph, model, {**motion, "load": load})
    gravity = rigid_torque(graph, tree, motion["q"], zero, zero)
    functions = [
        _function(
            "inverse_dynamics",
            "qva",
            "tau",
            load + laws,
            "torque of the bodies and of all laws",
        ),
        _function("gravity", "q", "tau", gravity, "torque of gravity"),
        _function("laws", "qva", "tau", laws, LAWS + TWICE * mass_matrix),
    ]
    if mass_matrix:
        columns = [_unit_torque(graph, tree, model, motion["q"], zero, j) for j in range(n)]
        matrix = np.array(columns).T.ravel()
        functions.append(_function("mass_matrix", "q", "mass", matrix, MASS))
    return Program(graph, tuple(functions), tuple(_notes(model)))


def _function(name: str, arguments: str, result: str, outputs: Expressions, meaning: str) -> Function:
    return Function(name, tuple(arguments), result, tuple(outputs), meaning)


def _unit_torque(
    graph: Graph, tree: Bodies, model: Model, q: Expressions, zero: Expressions, joint: int
) -> Expressions:
    """Column of the mass matrix (n,): torque at rest of a unit acceleration of one joint."""
    unit = zero.copy()
    unit[joint] = graph.constant(1.0)
    column = rigid_torque(graph, tree, q, zero, unit, gravity=False) + rotor_torque(tree, unit)
    return column + law_expressions(graph, _accelerated(model), {"q": q, "v": zero, "a": unit, "load": zero})


def _accelerated(model: Model) -> Model:
    """The model with the laws only that are linear in acceleration and need no motion, as a coupling of two joints."""
    return replace(
        model, laws=tuple(law for law in torque_model(model).laws if ACCELERATION.search(law.effect.equation))
    )


def _notes(model: Model) -> list[str]:
    left = [law for law in torque_model(model).laws if not writable(law) and not inertial(law)]
    words = lacking(model.robot, left, ())
    lead = "the code lacks laws that are no functions of position, velocity and acceleration: "
    return [*([lead + words] if words else []), *fixed_note(model.robot, "the code holds it there, too")]


def statements(
    program: Program, function: Function, words: Mapping[str, str], variable: Callable[[str], str], line: str
) -> tuple[list[str], list[str]]:
    """Lines that compute a function, one per operation, and the names or numbers of its outputs.

    words: format of each operation, in its operands; variable: text of an input such as "q[0]"; line: format of a line,
    in the name and the expression.
    """
    graph, names = program.graph, dict[int, str]()
    lines: list[str] = []
    for number in graph.used(function.outputs):
        operation, *inner = graph.nodes[number]
        if operation == "variable":
            names[number] = variable(inner[0])
        elif operation == "constant":
            names[number] = f"({inner[0]!r})" if inner[0] < 0 else repr(inner[0])
        else:
            names[number] = f"t{len(lines)}"
            lines.append(line.format(names[number], words[operation].format(*(names[k] for k in inner))))
    return lines, [names[output.number] for output in function.outputs]
