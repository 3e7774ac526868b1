"""Shipped JSON schemas: signid's documents follow them, and a saved model is checked before it is used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from example import notebook, unsigned
from jsonschema import Draft202012Validator

import signid
from signid.cli import run
from signid.errors import RobotError
from signid.output.report import to_json, write_files
from signid.output.report.results.diagnosis import diagnosis_document
from signid.output.report.results.identification import identification_document
from signid.toml_json import SCHEMAS, check_schema, read_json

DRIVE = Path(__file__).parents[1] / "robots" / "so101"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders `id`, `signs` and `diagnosis` with results on the 3r, and `servo` of a joint of an SO-101."""
    place, names = tmp_path_factory.mktemp("results"), notebook().names
    found, extended = to_json(diagnosis_document(names["found"])), to_json(names["found"].model.document())
    write_files(place / "diagnosis", {"diagnosis.json": found, "model.json": extended})
    for name, result in (("id", names["result"]), ("signs", unsigned())):
        write_files(place / name, {"identification.json": to_json(identification_document(result))})
    write_files(place / "id", {"model.json": to_json(names["result"].model.document())})
    motion = str(place / "short.csv")
    pl.read_csv(DRIVE / "recording.csv.gz")[:800].write_csv(motion)
    assert run(["identify", str(DRIVE / "arm.urdf"), motion, "-o", str(place / "servo")]) in (0, 3)
    return place


@pytest.mark.parametrize("name", sorted(path.stem for path in SCHEMAS.glob("*.json")))
def test_a_schema_is_valid(name: str) -> None:
    Draft202012Validator.check_schema(read_json(SCHEMAS / f"{name}.json"))


@pytest.mark.parametrize(
    "file",
    [
        "id/identification.json",
        "signs/identification.json",
        "diagnosis/diagnosis.json",
        "id/model.json",
        "diagnosis/model.json",
        "servo/identification.json",
        "servo/model.json",
    ],
)
def test_documents_follow_their_schema(file: str, results: Path) -> None:
    content = read_json(results / file)
    check_schema(content, Path(file).stem)
    for key in read_json(SCHEMAS / Path(file).name)["required"]:
        with pytest.raises(ValueError, match=f"'{key}' is a required property"):
            check_schema({k: v for k, v in content.items() if k != key}, Path(file).stem)


def test_blocks_of_servos_are_checked(results: Path) -> None:
    content = read_json(results / "servo" / "model.json")
    (servo,) = content["servos"].values()
    for key, value in (("kp", "stiff"), ("law", 3)):
        with pytest.raises(ValueError, match="servos"):
            check_schema({**content, "servos": {"wrist_flex": {**servo, key: value}}}, "model")


def put(content: Any, place: str, value: Any) -> Any:
    """The content with another value at a place such as `effects.0.joint`."""
    inner, keys = content, place.split(".")
    for key in keys[:-1]:
        inner = inner[int(key) if key.isdigit() else key]
    inner[int(keys[-1]) if keys[-1].isdigit() else keys[-1]] = value
    return content


@pytest.mark.parametrize(
    "value", ["x", None, [], {}, float("nan"), float("inf"), 1e308, 10**400, -(10**13), "1e308"], ids=repr
)
@pytest.mark.parametrize(
    "place",
    [
        "robot.description",
        "held",
        "torque_constants",
        "standard_parameters.link_2.mass",
        "standard_parameters.link_2",
        "standard_parameters.link_1.inertia",
        "standard_parameters.link_3.first_moment.0",
        "effects.0",
        "effects.0.parameters",
        "effects.0.effect",
        "covariance.values",
        "covariance.values.0",
        "covariance.names",
        "covariance.terms.0",
        "covariance.lower_triangle",
        "covariance.lower_triangle.0",
    ],
)
def test_a_damaged_model_is_refused_in_one_sentence(place: str, value: Any, results: Path, tmp_path: Path) -> None:
    content = read_json(results / "id" / "model.json")
    same = place in ("held", "torque_constants") and value == {} or place == "effects.0.parameters" and value == {}
    free = place == "covariance.lower_triangle.0" and value is None  # an unknown variance
    (tmp_path / "model.json").write_text(json.dumps(put(content, place, value)))
    if (same and "effects" not in place) or free:
        assert signid.load_model(tmp_path / "model.json").robot.name == "3r"
        return
    with pytest.raises(RobotError) as caught:
        signid.load_model(tmp_path / "model.json")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


@pytest.mark.parametrize(
    "content", ["[]", "null", "3", '"x"', "{}", "[" * 100_000, "{", '{"schema": "signid.model/1"}']
)
def test_another_content_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text(content)
    with pytest.raises(RobotError):
        signid.load_model(tmp_path / "model.json")


def test_a_thousand_laws_are_refused(results: Path, tmp_path: Path) -> None:
    content = read_json(results / "id" / "model.json")
    content["effects"] *= 1000
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(RobotError, match="effects"):
        signid.load_model(tmp_path / "model.json")
