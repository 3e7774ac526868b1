"""Inspection of a robot and check of its recordings: JSON documents and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ....types import TWO_SIDED, Input, Robot
from ..layout import (
    figure,
    heading,
    name_cell,
    new_table,
    note_lines,
    paragraph,
    plural,
    position_units,
    share,
    torque_units,
)
from .documents import Document, description, ending, excitation_verdict, picked, provenance, recorded
from .identification import base_documents, cutoff_words, excited_words

if TYPE_CHECKING:
    from ....check import Check
    from ....inspect import Inspection
    from ....recording.sampling import Sampling
    from ....recording_faults import RecordingFaults

VERDICTS = {"right": "green", "uncertain": "yellow", "wrong": "red"}
STYLES = {"identifiable": "green", "weak": "yellow", "unidentifiable": "red"}


def inspection_document(found: Inspection, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid inspect --json`; `inputs` defaults to the robot description."""
    robot = found.robot
    return {
        "schema": "signid.inspection/1",
        "robot": robot.name,
        "joints": joint_documents(robot),
        "links": list(robot.links),
        "base_parameters": base_documents(found.base),
        **picked(found, "invisible combined"),
        "notes": list(robot.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def inspection_tables(found: Inspection) -> list[RenderableType]:
    """Joints, links, base parameters as formulas, and unidentifiable parameters."""
    robot, base = found.robot, found.base
    joints = joint_table(robot)
    formulas = new_table("base parameter", "unit", rows=zip(base.expressions, base.units, strict=True))
    bodies: dict[int | None, list[str]] = {}
    for label in base.invisible:
        bodies.setdefault(label.body, []).append(label.name)
    hidden = new_table("link", "standard parameters")
    for body, names in bodies.items():
        hidden.add_row("(actuators)" if body is None else f"{body + 1}  {robot.links[body]}", ", ".join(names))
    size = f"{plural(len(robot.joints), 'joint')}, {plural(len(robot.links), 'moving link')}"
    counted = f"{base.rank} base parameters, combinations of {len(base.labels)} standard parameters"
    return [
        heading(f"{robot.name}: {size}", below=False),
        joints,
        heading(f"{counted} (indices: moving links)"),
        formulas,
        *([heading("Unidentifiable from any motion"), hidden] if base.invisible else []),
        paragraph(f"{plural(len(found.combined), 'standard parameter')}: identifiable only in combination."),
        *note_lines(robot.notes),
    ]


def joint_table(robot: Robot) -> Table:
    """Joints with their limits."""
    table = new_table("joint", "#>", "type", "carries link", "lower>", "upper>", "velocity>", "effort>", "unit")
    for joint in joint_documents(robot):
        name, number, kind, link, *limits, unit = joint.values()
        table.add_row(name, str(number), kind, name_cell(link), *map(figure, limits), unit)
    return table


def joint_documents(robot: Robot) -> list[Document]:
    """Actuated joints; limits in `unit`, `unit`/s and N.m or N, infinite if not stated."""
    bounded = np.isfinite(robot.upper - robot.lower)
    return [
        {
            "name": name,
            "number": robot.numbers[j],
            "type": "prismatic" if robot.prismatic[j] else "revolute" if bounded[j] else "continuous",
            "link": _link(robot, j),
            "lower": float(robot.lower[j]),
            "upper": float(robot.upper[j]),
            "velocity_limit": float(robot.velocity_limit[j]),
            "effort_limit": float(robot.effort_limit[j]),
            "unit": unit,
        }
        for j, (name, unit) in enumerate(zip(robot.joints, position_units(robot), strict=True))
    ]


def _link(robot: Robot, j: int) -> str:
    """Name of the link that the joint moves; a joint's own link precedes links of mimic joints."""
    rows = np.flatnonzero(robot.drive[:, j])
    bodies = zip(list(robot.model.names)[1:], list(robot.model.joints)[1:], robot.links, strict=True)
    moved = [
        (name != robot.joints[j], link)
        for name, joint, link in bodies
        if np.any((rows >= joint.idx_v) & (rows < joint.idx_v + joint.nv))
    ]
    return min(moved, key=lambda entry: entry[0])[1] if moved else ""


def check_document(found: Check, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid check --json`; `inputs` defaults to the robot description."""
    robot, band = found.robot, found.band
    read = [Input(recording.path, recording.sha256, "recording") for recording in found.recordings]
    joints = zip(robot.joints, band.per_joint.tolist(), found.used.tolist(), band.torque_floor.tolist(), strict=True)
    verdicts = zip(base_documents(found.base), found.std, found.verdicts, strict=True)
    return {
        "schema": "signid.check/1",
        "robot": robot.name,
        "joints": [dict(zip(("name", "cutoff", "used", "noise_floor"), joint, strict=True)) for joint in joints],
        "recordings": [
            {**recorded(recording, s), "rate": 1 / s.step, "duration": s.duration, "samples": s.rows}
            | {**picked(s, "spans duplicates uniform"), "spacing": list(s.jitter)}
            for recording, s in zip(found.recordings, found.samplings, strict=True)
        ],
        "cutoff": {"torque": band.cutoff, "position": band.position_cutoff, "unit": "Hz"},
        "base_parameters": [{**base, "std": float(std), "verdict": verdict} for base, std, verdict in verdicts],
        "excitation": excitation_verdict(found.excitation),
        "gross": _faults_document(found.faults),
        "advice": list(found.advice),
        **ending(found, read, inputs or [description(robot)], seed),
    }


def _faults_document(found: RecordingFaults) -> Document:
    sizes = (map(float, column) for column in (found.explained, found.factor, found.lag))
    joints = zip(found.joints, *sizes, found.signs, found.order, strict=True)
    keys = ("name", "explained", "factor", "lag", "sign", "order")
    return {
        "joints": [dict(zip(keys, joint, strict=True)) for joint in joints],
        "findings": [
            {
                **picked(finding, "kind joints severity measures sentence"),
                "alternatives": [{"kind": kind, "joints": list(joints)} for kind, joints in finding.alternatives],
            }
            for finding in found.findings
        ],
    }


def check_tables(found: Check) -> list[RenderableType]:
    """Sampling, cut-offs, and identifiability of the base parameters."""
    robot, band = found.robot, found.band
    sampling = new_table("recording", "rate [Hz]>", "duration [s]>", "samples>", "gaps>", "step [ms]>")
    paths = [recording.path for recording in found.recordings]
    names = [Path(path).name or "(arrays)" for path in paths]
    for name, s in zip(names if len(set(names)) == len(names) else paths, found.samplings, strict=True):
        sampling.add_row(name, *_sampling_cells(s))
    joints = new_table("joint", "highest cut-off [Hz]>", "rows used>", "torque noise>", "unit")
    columns = (robot.joints, band.per_joint, found.used, band.torque_floor, torque_units(robot))
    for joint, cutoff, used, floor, unit in zip(*columns, strict=True):
        joints.add_row(joint, figure(cutoff), share(used), figure(floor, 2), unit)
    expected = new_table("base parameter", "± (95 %)>", "unit", "verdict")
    base = zip(found.base.expressions, found.std, found.base.units, found.verdicts, strict=True)
    for expression, std, unit, verdict in base:
        expected.add_row(expression, figure(TWO_SIDED * std, 2), unit, Text(verdict, STYLES.get(verdict, "")))
    given = f"{plural(len(found.recordings), 'recording')} of {plural(len(robot.joints), 'joint')}"
    counts = ", ".join(f"{found.verdicts.count(verdict)} {verdict}" for verdict in STYLES)
    return [
        heading(f"{robot.name}: {given}", below=False),
        sampling,
        heading("Bandwidth allowed by encoder noise"),
        joints,
        paragraph(f"{cutoff_words(band.cutoff, band.position_cutoff)}."),
        heading("Comparison of the torque with the description"),
        _faults(found.faults),
        heading(f"{found.base.rank} base parameters: {counts}"),
        expected,
        paragraph(excited_words(found.excitation)),
        *(paragraph(f"advice: {sentence}") for sentence in found.advice),
        *note_lines(found.notes),
    ]


def _sampling_cells(found: Sampling) -> tuple[str, ...]:
    """Rate, duration, samples, gaps, jitter."""
    shortest, longest = (figure(1e3 * x) for x in found.jitter)
    spacing = shortest if shortest == longest else f"{shortest} to {longest}"
    rate = figure(1 / found.step, 4)
    return rate, figure(found.duration), str(found.rows), str(len(found.spans) - 1), spacing


def _faults(found: RecordingFaults) -> Table:
    """Share of the torque that the description explains, and verdicts on sign and order, per joint."""
    table = new_table("joint", "explained>", "factor>", "sign", "order")
    columns = (found.joints, found.explained, found.factor, found.signs, found.order)
    for joint, explained, factor, *verdicts in zip(*columns, strict=True):
        texts = (Text(str(verdict), VERDICTS[str(verdict)]) for verdict in verdicts)
        table.add_row(joint, share(float(explained)), figure(float(factor), 2), *texts)
    return table
