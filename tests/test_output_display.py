"""Results in a Python session: short reprs, escaped HTML, tables, saved models, completion."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from example import HELD_OUT, RECORDING, notebook, unsigned
from servo_results import invented

import signid
from signid.cli import run
from signid.output.display import TABLES
from signid.output.frames import FRAMES, frame_names
from signid.output.report.documents import WRITERS
from signid.servo.validate import ServoValidatedModel, ServoValidation

HOSTILE = '"><img src=x onerror=alert(1)>'


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    """One result of each kind that the verbs return, by the name of its class."""
    names, identified = notebook().names, unsigned()
    robot, recording, stated = names["robot"], names["recording"], signid.load_model("3r")
    validated = signid.validate({"stated": stated, "identified": identified}, HELD_OUT)
    motion = signid.excite(robot, kind="random", duration=5.0)
    drives = invented()
    loops = ServoValidatedModel("drives", drives.model, drives.rollout, drives.traces)
    looped = signid.simulate_servos(drives.model, motion.trajectory)
    found = (
        *(looped, drives, loops, ServoValidation((loops,), drives.inputs, (), (), 0)),
        *(identified.base, identified.estimate),
        *(robot, recording, identified, identified.signs, identified.fit, identified.model, validated),
        *(signid.check(robot, recording), signid.inspect(robot), names["found"]),
        *(signid.payload(robot, HELD_OUT, RECORDING), signid.roll_out(identified, HELD_OUT), validated.models[0]),
        motion,
        signid.simulate(robot, signid.track(robot, motion.trajectory), 0.5),
    )
    return {type(each).__name__: each for each in found}


@pytest.mark.slow
def test_a_repr_has_at_most_forty_lines_of_plain_text(results: dict[str, Any]) -> None:
    assert set(TABLES) - set(results) <= {"Fleet", "Separation", "ServoDiagnosis"}, "every other kind is tested here"
    for name, result in results.items():
        lines = repr(result).splitlines()
        assert 2 <= len(lines) <= 40 and max(map(len, lines)) <= 100, name
        assert lines[0] and "\x1b" not in repr(result) and "array(" not in repr(result), name
    text = repr(results["Identification"])
    assert "3r: 25 base parameters, 3 joints" in text and "coulomb friction" in text and "Torque signs" in text
    assert "tables, to_frame(name): base_parameters, laws" in text
    words = ("Coulomb friction of all joints", "Held-out", "Roll-outs")
    assert all(word in repr(results["Diagnosis"]) for word in words)


def test_flags_are_in_the_repr(results: dict[str, Any]) -> None:
    flagged = replace(results["Identification"], flags=("joint_2 did not move",))
    assert "\nflag: joint_2 did not move\n" in repr(flagged) and "flag: joint_2 did not move" in flagged._repr_html_()
    many = replace(flagged, flags=tuple(f"{k} is wrong" for k in range(99)), notes=("a note",) * 99)
    assert len(repr(many).splitlines()) == 40


def test_html_escapes_names(results: dict[str, Any]) -> None:
    robot = replace(results["Robot"], joints=(HOSTILE, "joint_2", "joint_3"), name=HOSTILE)
    for name in ("Identification", "Diagnosis", "Check", "Inspection", "Model"):
        html = replace(results[name], robot=robot)._repr_html_()
        assert "<img" not in html and "&lt;img" in html and html.count("<tr>") < 120, name
    assert "<img" not in robot._repr_html_()


def test_every_table_is_made(results: dict[str, Any]) -> None:
    for kind, result in results.items():
        for name in frame_names(result):
            frame = result.to_frame(name)
            assert isinstance(frame, pl.DataFrame) and frame.width >= 2, (kind, name)
    assert set(FRAMES) <= {*TABLES, *WRITERS}


def test_tables_hold_the_numbers(results: dict[str, Any]) -> None:
    result, found = results["Identification"], results["Diagnosis"]
    base = result.to_frame()
    assert base.columns == ["expression", "value", "std", "estimate", "unit"]
    assert np.array_equal(base["value"], result.base_value) and np.array_equal(base["std"], result.estimate.std)
    levels = result.to_frame("laws").filter(pl.col("law") == "coulomb_friction")
    assert levels["joint"].to_list() == list(result.robot.joints) and (levels["std"] > 0).all()
    assert result.to_frame("fit")["held_out_r2"].to_list() == result.fit.held_out_r2.tolist()
    assert len(result.to_frame("segments")) == len(result.signs.segments) > 30
    assert result.to_frame("standard_parameters").filter(pl.col("parameter") == "m").height == len(result.robot.links)
    findings = found.to_frame("findings")
    assert findings["probability"].to_list() == [finding.probability for finding in found.findings]
    rows = found.to_frame("residuals").filter(pl.col("joint") == "joint_2")
    assert np.array_equal(rows["after"], found.held_out.after[:, 1], equal_nan=True)
    assert found.to_frame("segments").is_empty() and "confidence" in found.to_frame("segments").columns
    samples = results["Recording"].to_frame()
    assert samples.shape == (6000, 7) and samples.columns[:2] == ["t", "q_joint_1"]


def test_pandas_frames_or_a_sentence(results: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    frame = results["Identification"].to_pandas("fit")
    assert type(frame).__module__.startswith("pandas") and list(frame["joint"]) == ["joint_1", "joint_2", "joint_3"]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(signid.SignidError, match=r"pandas is not installed; .* to_frame\(\)"):
        results["Identification"].to_pandas("fit")


def test_unknown_names_list_the_known_ones(results: dict[str, Any]) -> None:
    for act, sentence in (
        (lambda: results["Identification"].to_frame("law"), "no table 'law'; choose from base_parameters, laws"),
        (lambda: signid.report(results["Identification"], "x.html"), "a list of Input as inputs, not str"),
    ):
        with pytest.raises(signid.SignidError, match=sentence):
            act()


def test_a_saved_model_has_the_bytes_of_the_command(results: dict[str, Any], tmp_path: Path) -> None:
    assert run(["identify", "3r", str(RECORDING), "-o", str(tmp_path / "result")]) == 0
    written = tmp_path / "result" / "model.json"
    loaded = signid.load_model(written)
    saved = loaded.save(tmp_path / "new" / "copy.json")
    assert saved == tmp_path / "new" / "copy.json" and saved.read_bytes() == written.read_bytes()
    assert signid.identify("3r", RECORDING).model.save(saved).read_bytes() == written.read_bytes(), "replaced"
    assert [path.name for path in saved.parent.iterdir()] == ["copy.json"]
    with pytest.raises(signid.SignidError, match=r"does not end in .json; name it model.json"):
        loaded.save(tmp_path / "model.txt")
    with pytest.raises(signid.SignidError, match="cannot write"):
        loaded.save(written / "below.json")


def test_completion_lists_the_public_names_without_importing_them() -> None:
    code = "import signid, sys; print(*dir(signid)); print('numpy' in sys.modules or 'pinocchio' in sys.modules)"
    listed, heavy = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert {"identify", "diagnose", "load_model", "Options", "__version__"} <= set(listed.split())
    assert not {"sys", "TYPE_CHECKING", "NAMES"} & set(listed.split()) and heavy == "False"
