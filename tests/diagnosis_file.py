"""A diagnosis.json and its model.json that name given laws."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from signid.effects.naming import law_place, parse_law
from signid.model import load_model


def write_diagnosis(folder: Path, robot: str, laws: tuple[str, ...], verdict: str = "named") -> None:
    """Write both, as `signid diagnose` would if it were certain of those laws."""
    model = load_model(robot)
    found = [parse_law(text, model.robot) for text in laws]
    extended = replace(model, laws=(*model.laws, *found))
    findings = []
    for law in found:
        joint, values = law_place(law, model.robot)
        parameters = {key: {"value": value, "std": 0.001, "unit": ""} for key, value in values.items()}
        named = {"effect": law.effect.name, "joint": joint, "role": "cause", "probability": 0.9995}
        findings.append({**named, "parameters": parameters})
    document = {"schema": "signid.diagnosis/1", "verdict": verdict, "findings": findings}
    (folder / "diagnosis.json").write_text(json.dumps(document))
    (folder / "model.json").write_text(json.dumps(extended.document()))
