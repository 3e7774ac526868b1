"""Findings of a diagnosis, from the object or its file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...diagnose import Diagnosis
from ...effects import EFFECTS
from ...effects.naming import law_at
from ...errors import OptionError, SignidError
from ...model import Model, load_model
from ...toml_json import read_json
from ...types import Law

SCHEMA, MODEL = "signid.diagnosis/1", "model.json"


class ReplayFinding(NamedTuple):
    """A finding, as far as it is displayed."""

    law: Law
    std: Mapping[str, float | None]
    probability: float
    cause: bool


class ReplayFindings(NamedTuple):
    """A diagnosis, as far as it is displayed."""

    verdict: str
    after: Model  # the extended simulation
    findings: tuple[ReplayFinding, ...]


def read_found(diagnosis: Diagnosis | str | Path) -> ReplayFindings:
    """Read the findings of a Diagnosis, or of diagnosis.json with model.json in the same folder.

    Args:
        diagnosis: diagnosis or its file.

    Raises:
        OptionError: the file is not a diagnosis, or model.json is missing.
    """
    if isinstance(diagnosis, Diagnosis):
        findings = (ReplayFinding(x.law, x.std, x.probability, x.role == "cause") for x in diagnosis.findings)
        return ReplayFindings(diagnosis.verdict, diagnosis.model, tuple(findings))
    path = Path(diagnosis)
    path = path / "diagnosis.json" if path.is_dir() else path
    if path.is_file() and not path.with_name(MODEL).is_file():
        raise OptionError(f"there is no {MODEL} next to {path}; give diagnosis.json in its original folder")
    try:
        content = read_json(path)
        if content["schema"] != SCHEMA:
            raise OptionError(f"{path} holds {content['schema']!r}; expected {SCHEMA!r} as `signid diagnose` writes it")
        after = load_model(path.with_name(MODEL))
        return ReplayFindings(str(content["verdict"]), after, tuple(_finding(x, after) for x in content["findings"]))
    except OSError as error:
        raise OptionError(f"cannot read {path}: {error.strerror}; give diagnosis.json of `signid diagnose`") from None
    except SignidError:
        raise
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise OptionError(f"{path} is not a diagnosis.json of `signid diagnose` ({error!r})") from None


def _finding(entry: Mapping[str, Any], after: Model) -> ReplayFinding:
    numbers = entry["parameters"]
    values = {key: number["value"] for key, number in numbers.items()}
    return ReplayFinding(
        law=law_at(EFFECTS[entry["effect"]], after.robot, entry["joint"], values),
        std={key: number["std"] for key, number in numbers.items()},
        probability=float(entry["probability"]),
        cause=entry["role"] == "cause",
    )
