"""Published models: named as simulations, with their provenance, and made again from the recordings."""

from __future__ import annotations

import importlib.util
import json
import os
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import signid
from signid.cli import run
from signid.errors import OptionError, SignidError

ROBOTS = Path(__file__).parents[1] / "robots"
MODELS = sorted(path.parent.name for path in ROBOTS.glob("*/model.json"))
LARGEST = 100_000  # [bytes] of a model.json


def publisher() -> ModuleType:
    spec = importlib.util.spec_from_file_location("publish", ROBOTS / "publish.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def content(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((ROBOTS / name / "model.json").read_text(encoding="utf-8"))
    return found


def test_the_models_are_those_of_the_table() -> None:
    assert MODELS == sorted(publisher().published()) and {"go2", "xl330", "panda", "ur10e"} <= set(MODELS)


@pytest.mark.parametrize("name", MODELS)
def test_a_published_model_says_where_it_comes_from(name: str) -> None:
    stated, text = content(name)["published"], (ROBOTS / name / "model.json").read_text(encoding="utf-8")
    assert len(text) < LARGEST and f"| `{name}` |" in (ROBOTS / "README.md").read_text(encoding="utf-8")
    assert stated["date"] == "2026-11-28" and stated["source"].startswith("github.com/") and stated["licence"]
    assert stated["command"].startswith("signid identify ") and stated["recordings"] and stated["held_out"]
    assert all("interval" in one or "stated" in one or one["not_identifiable"] for one in stated["numbers"])
    assert all(one["rms"] < one["without"] for one in stated["held_out"] if "without" in one)


@pytest.mark.parametrize("name", MODELS)
def test_a_name_is_the_model_as_simulation_and_the_description_as_robot(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved, robot = signid.load_model(ROBOTS / name / "model.json"), signid.load_robot(name)
    assert set(saved.robot.joints) <= set(robot.joints)
    assert len(signid.load_model(robot).laws) < len(saved.laws)
    for which in (name.upper(), str(ROBOTS / name / "model.json")):
        lacks = 3 if "motor_friction" in {law.effect.name for law in saved.laws} else 0  # flagged: more than 2 %
        assert run(["export", which, "--mjcf", str(tmp_path / f"{len(which)}.xml")]) == lacks
    first, second = (path.read_text().split("<worldbody>")[1] for path in sorted(tmp_path.glob("*.xml")))
    assert first == second
    capsys.readouterr()
    assert run(["simulate", name, "--duration", "0.2", "--json"]) == 0
    stated = json.loads(capsys.readouterr().out.partition("{")[2].join(["{", ""]))
    own = (ROBOTS / name / "robot.urdf").is_file()  # else the name is that of a description of example-robot-data
    assert [one["path"] for one in stated["inputs"] if one["role"] == "model"] == ([name] if own else [])
    assert len(signid.load_model(name).laws) == len((saved if own else signid.load_model(robot)).laws)


def test_a_published_model_states_its_joints_and_actuators(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "panda", "--joints", "panda_joint1", "--duration", "0.1", "--json"]) == 0
    with pytest.raises(OptionError, match="states its actuators itself"):
        signid.load_model("ur10e", actuators="actuators.toml")


def test_a_description_beside_has_priority(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ur10e").mkdir()
    monkeypatch.chdir(tmp_path)
    assert len(signid.load_model("ur10e").robot.joints) == 6
    (tmp_path / "ur10e" / "robot.urdf").write_text((ROBOTS / "3r" / "robot.urdf").read_text())
    assert len(signid.load_model("ur10e").robot.joints) == 3


@pytest.mark.slow
def test_the_panda_is_identified_again(capsys: pytest.CaptureFixture[str]) -> None:
    if not os.environ.get("SIGNID_DATA"):
        pytest.skip("SIGNID_DATA is unset: real recordings are not part of the repository")
    made, stored = publisher().identify("panda")["published"]["numbers"], content("panda")["published"]["numbers"]
    assert [one["number"] for one in made] == [one["number"] for one in stored]
    assert all(abs(one["value"] - other["value"]) <= other["interval"] for one, other in zip(made, stored, strict=True))


def test_a_model_without_recordings_is_refused_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    publish = publisher()
    monkeypatch.delenv("SIGNID_DATA", raising=False)
    with pytest.raises(SignidError, match="SIGNID_DATA is not set"):
        publish.identify("panda")
    with pytest.raises(SignidError, match="no published model baxter"):
        publish.main(["baxter"])
