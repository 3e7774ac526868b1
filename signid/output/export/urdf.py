"""Export of a model as the robot's URDF."""

from __future__ import annotations

import re

import numpy as np

from ...model import Model, stated_inertials
from .beyond import BODIES, Exported, commented, fixed_note, held, lacking, summed
from .edit import urdf_with

FRICTION = ("viscous_friction", "coulomb_friction")
_DECLARATION = re.compile(r"\s*<\?xml\s[^>]*\?>")


def write_urdf(model: Model) -> Exported:
    """Write the robot's URDF with the model's inertials, damping and friction; a comment lists what it cannot hold.

    Unchanged links are kept byte for byte. Friction that the model lacks is removed.

    Args:
        model: rigid bodies and laws.

    Raises:
        RobotError: the robot was not loaded from a URDF, or a body cannot be written.
    """
    robot = model.robot
    bodies = model.whole_inertials()
    same = np.all(np.isclose(bodies, stated_inertials(robot), rtol=1e-12, atol=1e-15), axis=1, keepdims=True)
    friction = (np.maximum(0.0, np.nan_to_num(summed(model, name))) for name in FRICTION)
    text = urdf_with(robot, np.where(same, np.nan, bodies), *friction)
    carried = [*held(model, FRICTION), *(law for law in model.laws if law.effect.name in BODIES)]
    notes = fixed_note(robot, "they move in the URDF")
    if beyond := lacking(robot, model.laws, carried):
        notes.append(f"a URDF cannot hold {beyond}")
    if any(law.effect.name == "base_tilt" for law in model.laws):
        notes.append(
            f"the gravity of the model is {' '.join(repr(float(x)) for x in model.bodies().gravity.linear)} m/s2"
        )
    return Exported(_with_comment(text, notes), tuple(notes))


def _with_comment(text: str, notes: list[str]) -> str:
    """Insert the notes as a comment before the root element."""
    if not notes:
        return text
    newline = "\r\n" if "\r\n" in text else "\n"
    comment = f"<!-- {newline.join(commented(notes).splitlines())} -->"
    declared = _DECLARATION.match(text)
    if declared is None:
        return f"{comment}{newline}{text}"
    return f"{text[: declared.end()]}{newline}{comment}{text[declared.end() :]}"
