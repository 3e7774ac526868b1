"""Export of a model's laws as a Python file that needs only NumPy, from their own equations."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ...effects.base import FUNCTIONS, ActuatorLaw, BodyLaw, RecordingLaw, TorqueLaw, TransmissionLaw
from ...model import Model, torque_model
from ...robot import described_gravity
from ...types import Law
from ..report.layout import torque_units
from .bodies import BODIES, Exported, among, lacking
from .drives import drive_note
from .mjcf import mjcf_laws

_SIGNALS = ("t", "q", "v", "a", "load", "jacobian")
_VARIABLES = ("q", "v", "a", "load")  # variable of an empirical torque, by its number
_REASONS = {
    RecordingLaw: "changes the recorded values, not the torque",
    ActuatorLaw: "limits the torque of the actuator, independent of the motion",
    TransmissionLaw: "has its own dynamics between motor and link",
}
_HEAD = '''"""Torque of the laws of a signid model of {name}, in addition to the rigid bodies.

    total torque = inverse dynamics of the exported URDF, without friction and armature + torque(q, v, a{arguments})
    total torque = inverse dynamics of the exported MJCF in MuJoCo + torque(q, v, a{arguments}, mjcf=True){lacks}
"""

import numpy as np

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

    Bodies and gravity belong to the URDF and the MJCF; other laws that are not functions of time and motion are noted.
    """
    robot, inside = model.robot, mjcf_laws(model)
    written = [(law, code) for law in torque_model(model).laws if (code := _code_of(law)) is not None]
    notes = _notes(model, [law for law, _ in written]) + drive_note("this file", model)
    more = [key for key in _EXPLAINED if any(key in code.signals for _, code in written)]
    keyword = {"t": "t=0.0", "load": "load", "jacobian": "jacobian"}
    signals = [key for key in ("q", "v", "a", *more) if key != "t"]
    lacks = "".join(f"\n\n{note[:1].upper()}{note[1:]}." for note in notes)
    head = _HEAD.format(
        name=_quoted(robot.name),
        arguments="".join(f", {key}={key}" for key in more),
        lacks=_quoted(lacks),
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
    return Exported(head + (gravity if tilted else "") + _functions(written) + table + body, tuple(notes))


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


def _notes(model: Model, written: list[Law]) -> list[str]:
    """Notes on laws that are in other files, and on laws that are in none."""
    robot, notes = model.robot, []
    left = [law for law in torque_model(model).laws if not among(law, written)]
    bodies = [law for law in left if law.effect.name in BODIES]
    if bodies:
        notes.append(f"the inertials of the exported URDF and MJCF hold {lacking(robot, bodies, ())}")
    inside = [law for law in left if among(law, mjcf_laws(model)) and law.effect.name not in BODIES]
    if inside:
        tilted = any(law.effect.name == "base_tilt" for law in inside)
        notes.append(f"only the MJCF holds {lacking(robot, inside, ())}{'; elsewhere, use GRAVITY' if tilted else ''}")
    reasons: dict[str, list[Law]] = {}
    for law in left:
        if not among(law, (*bodies, *inside)):
            other = "has a memory" if law.effect.memory else "needs the rigid bodies"
            why = next((text for kind, text in _REASONS.items() if isinstance(law.effect, kind)), other)
            reasons.setdefault(why, []).append(law)
    lead = "not in this file, since not a function of time and motion"
    return [*notes, *(f"{lead}: {lacking(robot, laws, ())}, which {why}" for why, laws in reasons.items())]


def _quoted(text: str) -> str:
    """Escape text for a docstring."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


class _Code(NamedTuple):
    """A law as a NumPy function: name, arguments, parameters and returned expression."""

    name: str
    signals: tuple[str, ...]  # subset of _SIGNALS
    numbers: dict[str, Any]
    expression: str


def _code_of(law: Law) -> _Code | None:
    """Translate a law; None if it is not a function of time, motion, load and Jacobian."""
    effect = law.effect
    if not isinstance(effect, TorqueLaw | BodyLaw) or effect.memory:
        return None
    name, renamed = effect.name, dict[str, str]()
    numbers: dict[str, Any] = {key: float(x) for key, x in effect.filled(law.parameters).items()}
    if name == "empirical":
        name, numbers, renamed = _empirical(numbers)
    try:
        tree = ast.parse(effect.equation, mode="eval")
    except SyntaxError:
        return None
    code = _Plain(set(numbers), renamed)
    expression = ast.unparse(code.visit(tree))
    if effect.scope not in ("joint", "pair", "robot") or not code.known:
        return None
    return _Code(name, tuple(s for s in _SIGNALS if s in code.used), numbers, expression)


def _empirical(numbers: dict[str, float]) -> tuple[str, dict[str, Any], dict[str, str]]:
    """Name, parameters with knots and values as lists, and renamed variable of an empirical torque."""
    signal = _VARIABLES[int(numbers["variable"])]
    lists = {key + "s": [x for k, x in numbers.items() if k.startswith(f"{key}_")] for key in ("knot", "value")}
    return f"empirical_{signal}", lists, {"variable": signal}


class _Plain(ast.NodeTransformer):
    """Replace functions by NumPy's; record the signals used and whether all names are known."""

    def __init__(self, numbers: set[str], renamed: dict[str, str]) -> None:
        self.numbers, self.renamed = numbers, renamed
        self.used: set[str] = set()
        self.known = True

    def visit_Name(self, node: ast.Name) -> ast.expr:
        name = self.renamed.get(node.id, node.id)
        if name in self.numbers:
            return ast.Name(name)
        if name in _SIGNALS:
            self.used.add(name)
            return ast.Name(name)
        self.known &= name in FUNCTIONS or name == "norm"
        return ast.Attribute(ast.Name("np"), name if name != "norm" else "linalg.norm")
