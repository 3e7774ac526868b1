"""Exciting and discriminating motions: JSON document and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType

from ....simulation.excite import Excitation, Separation
from ....types import Input, Robot
from ..layout import heading, new_table, note_lines, paragraph, plural
from ..numbers import figure, share
from .documents import Document, description, provenance
from .simulation import law_document

LIMITS = ("position", "velocity", "acceleration", "torque")
SHOWN = 8  # number of least identifiable base parameters listed
UNIDENTIFIABLE = 1.0  # relative standard deviation from which a parameter is not distinguishable from zero


def excitation_document(
    robot: Robot, found: Excitation | Separation, inputs: Sequence[Input] = (), seed: int = 0
) -> Document:
    """Build the output of `signid excite --json`.

    Args:
        robot: robot that moves.
        found: motion.
        inputs: path and sha256 of the files read; default: the robot description.
        seed: seed of the search.
    """
    apart = isinstance(found, Separation)
    return {
        "schema": "signid.excitation/1",
        "robot": robot.name,
        "joints": list(robot.joints),
        "duration": float(found.trajectory.t[-1]),
        "rows": len(found.trajectory.t),
        "purpose": "separate" if apart else "excite",
        **(_separation(robot, found) if isinstance(found, Separation) else _excitation(found)),
        "noise": found.noise,
        "torque_unit": ["N" if p else "N.m" for p in robot.prismatic],
        "use": {name: getattr(found.use, name) for name in LIMITS},
        "smallest_distance": found.distance,
        "flags": list(found.flags),
        "notes": list(found.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def excitation_tables(robot: Robot, found: Excitation | Separation) -> list[RenderableType]:
    """Use of the limits, and identifiability or distance of laws along the motion."""
    limits = new_table("share of limit", *(f"{name}>" for name in LIMITS))
    for row in zip(robot.joints, *(getattr(found.use, name) for name in LIMITS), strict=True):
        limits.add_row(row[0], *(share(float(x)) for x in row[1:]))
    near = (
        []
        if found.distance is None
        else [paragraph(f"Smallest distance between links: {figure(1e3 * found.distance)} mm.")]
    )
    gained = _discrimination(robot, found) if isinstance(found, Separation) else _identifiability(found)
    size = f"{plural(len(found.trajectory.t), 'row')}, {figure(float(found.trajectory.t[-1]))} s"
    return [heading(f"{robot.name}: {size}", below=False), limits, *near, *gained, *note_lines(found.notes)]


def _excitation(found: Excitation) -> dict[str, Any]:
    rows = zip(found.expressions, found.std, found.relative_std, strict=True)
    return {
        "kind": found.kind,
        "criterion": found.criterion,
        "value": found.value,
        "log_det": found.log_det,
        "condition": found.condition,
        "base_parameters": [{"expression": e, "std": s, "relative_std": r} for e, s, r in rows],
        "evaluations": found.evaluations,
    }


def _separation(robot: Robot, found: Separation) -> dict[str, Any]:
    return {
        "laws": [law_document(robot, law) for law in found.laws],
        "distances": list(found.distances),
        "shares": list(found.shares),
        "median": found.median,
        "structural": found.structural,
        "enough": found.enough,
    }


def _identifiability(found: Excitation) -> list[RenderableType]:
    table = new_table("base parameter", "std over value>")
    order = [k for k in np.argsort(-np.nan_to_num(found.relative_std, nan=0.0)) if np.isfinite(found.relative_std[k])]
    for k in order[:SHOWN]:
        table.add_row(found.expressions[k], share(float(found.relative_std[k])))
    weak = int(np.sum(found.relative_std[order] >= UNIDENTIFIABLE))
    quality = (
        f"Condition number of the regressor {figure(found.condition)}, log det of the information {found.log_det:.1f}"
    )
    return [
        paragraph(f"{quality}; {plural(found.evaluations, 'motion')} tried."),
        heading(f"Least identifiable of {plural(len(found.std), 'base parameter')}"),
        table,
        *([paragraph(f"{weak} of them will hardly be distinguishable from zero.")] if weak else []),
    ]


def _discrimination(robot: Robot, found: Separation) -> list[RenderableType]:
    table = new_table("true law", "joint", "distance of the other>", "share of its torque unexplained>")
    for law, distance, part in zip(found.laws, found.distances, found.shares, strict=True):
        entry = law_document(robot, law)
        table.add_row(entry["effect"], entry["joint"] or "(robot)", figure(distance), share(part))
    if found.structural:
        verdict = "No motion can discriminate these laws."
    elif found.enough:
        verdict = f"The motion discriminates the laws; a random motion reaches {figure(found.median)} (median)."
    else:
        verdict = "The laws may remain indistinguishable."
    return [heading("Distance of the laws: squared difference of torque over noise"), table, paragraph(verdict)]
