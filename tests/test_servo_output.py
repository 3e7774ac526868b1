"""Models with position drives are saved and loaded, and hold no law twice."""

from __future__ import annotations

import json
import re
from pathlib import Path

import polars as pl
import pytest
from jsonschema import Draft202012Validator
from servo_results import invented

import signid
from signid.model import Model, load_model, with_servos
from signid.output.report import to_json
from signid.output.report.plots import closed_loop_plots
from signid.output.report.results.servo_identification import servo_identification_document
from signid.servos import PASSIVE_LAWS, Servo
from signid.toml_json import SCHEMAS, check_schema

DUTY = Servo(law="duty", kp=1.1, kd=0.05, delay=0.01, effort_limit=0.8, coulomb_friction=0.1, torque_offset=-0.2)
REGISTER = Servo(kp=20.0, kd=0.5, kp_register=400.0)


@pytest.fixture
def servo_model() -> Model:
    """The 3r with drives at two of its joints."""
    return with_servos(load_model("3r"), {"joint_1": DUTY, "joint_3": REGISTER})


def test_a_model_with_servos_loads_back(servo_model: Model, tmp_path: Path) -> None:
    path = servo_model.save(tmp_path / "model.json")
    content = json.loads(path.read_text())
    assert "speed_limit" not in content["servos"]["joint_1"], "infinite numbers are left out"
    assert not list(Draft202012Validator(json.loads((SCHEMAS / "model.json").read_text())).iter_errors(content))
    assert signid.load_model(path).servos == {"joint_1": DUTY, "joint_3": REGISTER}


def test_a_number_of_a_drive_replaces_the_law_of_its_joint(tmp_path: Path) -> None:
    (tmp_path / "actuators.toml").write_text("[joint.joint_1]\narmature = 0.1\n[joint.joint_2]\narmature = 0.2\n")
    stated = load_model("3r", actuators=tmp_path / "actuators.toml")
    kept = [law for law in with_servos(stated, {"joint_1": DUTY}).laws if law.effect.name == "armature"]
    assert [law.joints for law in kept] == [(0,), (1,)], "the drive states no armature"
    driven = with_servos(stated, {"joint_1": DUTY.with_(armature=0.3)})
    assert [(law.effect.name, law.joints) for law in driven.laws_beside_drives] == [("armature", (1,))]
    assert driven.servos["joint_1"].armature == 0.3
    assert all(hasattr(DUTY, name) for name in PASSIVE_LAWS)


def test_the_document_follows_its_schema_and_the_contract() -> None:
    result = invented()
    content = json.loads(to_json(servo_identification_document(result)))
    check_schema(content, "identification")
    servo = content["servo"]
    assert servo["scale"]["set_by"] == "inertials of the description"
    assert servo["scale"]["share_of_known_load"] == {"joint_1": 0.62, "joint_2": 0.9, "joint_3": 0.03}
    first, stated, unknown = servo["joints"]
    assert first["kp"] == {"value": 1.1, "std": 0.06, "unit": "N.m/rad"}
    assert first["damping"]["is"] == "kd + viscous_friction + back_emf"
    assert first["effort_limit"]["saturated_share"] == 0.03
    assert stated["kp"]["stated"] == 20.0 and stated["kp"]["std"] is None and stated["law_probability"] is None
    assert unknown["kp"]["value"] is None and "known load" in unknown["kp"]["sentence"]
    assert servo["rollout"]["held_out"] and servo["rollout"]["whole_rms"] == [0.0123, 0.0456, 0.00789]
    assert stated["effort_limit"]["above"] == 1.3 and "below" not in stated["effort_limit"]
    assert servo["rollout"]["tracking_rms"] == pytest.approx([0.0615, 0.228, 0.03945])
    assert [entry["effect"] for entry in content["effects"]] == ["armature", "coulomb_friction"]


def test_the_schema_accepts_the_names_of_version_0_1() -> None:
    content = json.loads(to_json(servo_identification_document(invented())))
    scale, joints = content["servo"]["scale"], content["servo"]["joints"]
    scale["told_by"] = scale.pop("set_by")
    for joint in joints:
        joint["not_told"] = joint.pop("not_identifiable")
    check_schema(content, "identification")
    del scale["told_by"], joints[0]["not_told"]
    with pytest.raises(ValueError):
        check_schema(content, "identification")


def test_what_is_not_identifiable_has_no_number_on_the_terminal() -> None:
    shown = repr(invented())
    assert "Not identifiable\n" in shown and "20.0 (stated)" in shown and "1.10 ± 0.12" in shown
    assert "> 1.3" in shown and "< and > are bounds" in shown, "what no sample reaches has a bound"
    assert "joint_1, joint_2: kd apart" in shown
    assert len(shown.splitlines()) <= 40


def test_the_page_shows_hostile_names_as_text() -> None:
    page = signid.report(invented())
    assert "<b>out</b>" not in page.replace("\\u003c", "<") and "held &lt;b&gt;out&lt;/b&gt;.csv" in page
    assert signid.report(invented()) == page
    assert "http://" not in re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)


def test_results_have_tables() -> None:
    result = invented()
    assert result.to_frame("drives").filter(pl.col("value").is_null()).height == 6
    assert result.to_frame("closed_loops").height == 3 and result.to_frame("positions").height == 1500
    first, *_ = closed_loop_plots(result.traces, result.rollout)
    assert sum(len(plot.data) for plot in first.plots) == 9, "q = q_des is the command, drawn once"
    assert "not identifiable" in result._repr_html_()
