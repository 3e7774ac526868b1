"""Restriction of models and recordings to their common joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ..errors import OptionError, shorten
from ..model import Model
from ..recording import same_joints
from ..simulation.rollout.joints import restrict_joints
from ..types import Recording


class ModelCandidate(NamedTuple):
    """Model to be validated, and the recordings of its joints."""

    name: str
    model: Model
    recordings: tuple[Recording, ...]
    notes: tuple[str, ...]


def share_joints(name: str, model: Model, recordings: Sequence[Recording]) -> ModelCandidate:
    """Model and recordings of the joints that both have.

    Args:
        name: name of the model, for messages.
        model: model to be restricted.
        recordings: recordings of equal joints.

    Raises:
        OptionError: model and recordings have no joint in common.
    """
    recorded = same_joints(recordings)
    shared = tuple(joint for joint in model.robot.joints if joint in recorded)
    if not shared:
        raise OptionError(
            f"{name} moves {shorten(model.robot.joints)}, the recordings {shorten(recorded)}; give a model and "
            f"recordings of the same joints"
        )
    given = tuple(r if r.joints == shared else _of_joints(r, shared) for r in recordings)
    restricted, notes = restrict_joints(model, given)
    return ModelCandidate(name, restricted, given, tuple(f"{name}: {note}" for note in notes))


def _of_joints(recording: Recording, joints: Sequence[str]) -> Recording:
    """Recording of some of its joints, in the given order."""
    kept = [recording.joints.index(joint) for joint in joints]
    columns = {key: c if key == "t" else tuple(c[k] for k in kept) for key, c in recording.columns.items() if c}
    return replace(
        recording,
        joints=tuple(joints),
        columns=columns,
        torque_per_unit=recording.torque_per_unit[kept],
        signed=recording.signed[kept],
        scaled=None if recording.scaled is None else recording.scaled[kept],
    )
