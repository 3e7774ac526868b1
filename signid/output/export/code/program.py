"""Functions of a model as expressions: inverse and forward dynamics, gravity, laws, mass matrix, Jacobian, payload."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ....errors import RobotError
from ....model import Model, torque_model
from ....robot import configuration
from ....robot.dynamics import mass_matrices
from ..beyond import fixed_note, lacking
from .frame import JACOBIAN, PAYLOAD, frame_of, jacobian, payload_torque
from .graph import Graph, Scalar, binary
from .laws import inertial, law_expressions, writable
from .mass import accelerations, mass_matrix
from .rigid import Expressions, rigid_torque, rotor_torque, tree_of

MASS = (
    "mass matrix by rows, of the bodies, the armature and couplings of joints: mass_matrix(q) a + "
    "inverse_dynamics(q, v, 0) = inverse_dynamics(q, v, a) where no law depends on load or is a curve over acceleration"
)
LAWS = (
    "torque of the laws alone: armature, friction, springs, offsets; mass_matrix holds the armature, too: "
    "inverse_dynamics(q, v, a) is mass_matrix(q) a + Coriolis torque + gravity(q) + laws(q, v, 0)"
)
TRACKING = (
    "inverse_dynamics, but with sign(v) of every law as tanh(v_desired / width), so that measured noise at rest does "
    "not switch friction; levels that vary with speed are those at v_desired; laws that are continuous in the "
    "velocity, such as viscous friction, act at v; width [rad/s or m/s]: 0.76 of dry friction at v_desired = width, "
    "0.995 at 3 width; values below 1e-9 act as 1e-9"
)
NONLINEAR = "h(q, v): Coriolis and centrifugal torque and gravity of the bodies, without laws"
FORWARD = (
    "accelerations at torque tau: mass_matrix(q) a = tau - inverse_dynamics(q, v, 0); friction that depends on load is "
    "that at a = 0, and a joint at v = 0 has no dry friction"
)
SMALLEST = 1e-9  # [rad/s or m/s] width of smoothing
ROUNDED = 1e-12  # least ratio of eigenvalues of a mass matrix that is not singular by rounding
ACCELERATION = re.compile(r"\ba\b")  # in the equation of a law


@dataclass(frozen=True)
class Function:
    """A function of the motion: names of its arguments, and its outputs as nodes of one graph."""

    name: str
    arguments: tuple[str, ...]  # "q", "v", "a", "v_desired", "tau": (n,); "payload": (10,); "width"
    result: str
    outputs: tuple[Scalar, ...]  # (n,), or by rows (n * n,) or (6 * n,)
    meaning: str


@dataclass(frozen=True)
class Program:
    """Functions of a model over one graph, and notes on laws that they lack."""

    graph: Graph
    functions: tuple[Function, ...]
    notes: tuple[str, ...]


def program_of(
    model: Model, *, tracking: bool = False, further: Collection[str] = (), link: str | None = None
) -> Program:
    """Functions of a model.

    Args:
        model: rigid bodies and laws.
        tracking: whether friction by a desired velocity is written.
        further: functions on request: "nonlinear", "forward", "jacobian", "payload".
        link: link of the Jacobian and the payload; None: that of the last joint.

    Raises:
        RobotError: a joint is neither revolute nor prismatic, no link has that name, or the mass matrix of "forward" is
            not positive definite.
    """
    graph, tree, n = Graph(), tree_of(model), len(model.robot.joints)
    zero = np.array([graph.constant(0.0)] * n)
    q, v, a = motion = tuple(vector(graph, key, n) for key in "qva")
    load = rigid_torque(graph, tree, q, v, a)
    signals = dict(zip(("q", "v", "a", "load"), (*motion, load), strict=True))
    weight = rigid_torque(graph, tree, q, zero, zero)
    graph.section = "rotors"
    rotors = rotor_torque(tree, a)
    laws = rotors + law_expressions(graph, model, signals)
    matrix = mass_matrix(graph, tree, q) + _coupled(graph, model, q)
    graph.section = "sum"
    functions = [
        _function("inverse_dynamics", "q v a", "tau", load + laws, "torque of the bodies and of all laws"),
        _function("gravity", "q", "tau", weight, "torque of gravity"),
        _function("laws", "q v a", "tau", laws, LAWS),
        _function("mass_matrix", "q", "mass", matrix.ravel(), MASS),
    ]
    if tracking:
        graph.section = "inverse width"
        rate = 1.0 / binary("maximum", graph.variable("width"), graph.constant(SMALLEST))
        smooth = law_expressions(graph, model, signals, (vector(graph, "v_desired", n), rate))
        graph.section = "sum"
        functions.append(_function("tracking_torque", "q v a v_desired width", "tau", load + rotors + smooth, TRACKING))
    bias = rigid_torque(graph, tree, q, v, zero)
    if "nonlinear" in further:
        functions.append(_function("nonlinear_effects", "q v", "tau", bias, NONLINEAR))
    if "forward" in further:
        _check_mass(model)
        still = law_expressions(graph, model, {**signals, "a": zero, "load": bias})
        graph.section = "accelerations by the factors of the mass matrix"
        solved = accelerations(graph, matrix, vector(graph, "tau", n) - bias - still)
        functions.append(_function("forward_dynamics", "q v tau", "a", solved, FORWARD))
    frame = frame_of(model, link)
    if "jacobian" in further:
        rows = jacobian(graph, tree, frame, q).ravel()
        functions.append(_function("frame_jacobian", "q", "jacobian", rows, JACOBIAN.format(frame.name)))
    if "payload" in further:
        torque = payload_torque(graph, tree, frame, motion, vector(graph, "payload", 10))
        functions.append(_function("payload_torque", "q v a payload", "tau", torque, PAYLOAD.format(frame.name)))
    return Program(graph, tuple(functions), tuple(_notes(model)))


def _check_mass(model: Model) -> None:
    """Check that the mass matrix can be inverted, at random positions."""
    robot, whole = model.robot, model.bodies()
    lower, upper = (np.clip(limit, -3, 3) for limit in (robot.lower, robot.upper))
    q = np.random.default_rng(0).uniform(lower, upper, (100, len(robot.joints)))
    masses = mass_matrices(whole, whole.createData(), configuration(robot, q), robot.drive)
    inertias = np.linalg.eigvalsh(masses)
    if not (inertias[:, 0] > ROUNDED * inertias[:, -1]).all():
        raise RobotError(
            f"forward dynamics of {robot.name} cannot be written, since its mass matrix is not positive definite "
            f"everywhere; state the armature of its joints, identify physically consistent inertias, or leave "
            f"`forward` out"
        )


def vector(graph: Graph, key: str, size: int) -> Expressions:
    """Variables of an argument that is an array (size,)."""
    return np.array([graph.variable(f"{key}[{j}]") for j in range(size)])


def _function(name: str, arguments: str, result: str, outputs: Expressions, meaning: str) -> Function:
    return Function(name, tuple(arguments.split()), result, tuple(outputs), meaning)


def _coupled(graph: Graph, model: Model, q: Expressions) -> Expressions:
    """Part of the mass matrix (n, n) of the laws that are linear in acceleration, as a coupling of two joints."""
    laws = (law for law in torque_model(model).laws if ACCELERATION.search(law.effect.equation))
    model, zero = replace(model, laws=tuple(laws)), np.array([graph.constant(0.0)] * len(q))
    units = np.array([graph.constant(x) for x in np.eye(len(q)).ravel()]).reshape(len(q), len(q))
    columns = [law_expressions(graph, model, {"q": q, "v": zero, "a": unit, "load": zero}) for unit in units]
    return np.array(columns).T


def _notes(model: Model) -> list[str]:
    left = [law for law in torque_model(model).laws if not writable(law) and not inertial(law)]
    words = lacking(model.robot, left, ())
    lead = "the code lacks laws that are no functions of position, velocity and acceleration: "
    return [*([lead + words] if words else []), *fixed_note(model.robot, "the code holds it there, too")]


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
