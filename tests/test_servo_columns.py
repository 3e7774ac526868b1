"""Signs and zeros that an identification finds reach the user: flags, JSON, and a column map that works as it is."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from test_servo_cli import recording

from signid.cli import run
from signid.cli.commands.drives import revised_columns
from signid.recording import read_recording
from signid.recording.mapping import Turned, revised_map
from signid.robot import load_robot
from signid.servo.identify.run import zero_flags
from signid.servo.zeros import JointZero
from signid.toml_json import check_schema

ZERO = 0.6  # [rad]


def shifted(path: Path, seed: int) -> Path:
    """A recording of the 1r in degrees, under other names, with another zero."""
    table = pl.read_csv(recording(path, seed))
    q, command = (column for column in table.columns if column != "t")
    turned = [np.degrees(table[name].to_numpy() - ZERO) for name in (q, command)]
    pl.DataFrame({"t": table["t"], "pos": turned[0], "goal": turned[1]}).write_csv(path)
    return path


def zeros_of(folder: Path) -> list[dict[str, Any]]:
    content = json.loads((folder / "identification.json").read_text())
    check_schema(content, "identification")
    return list(content["servo"]["zeros"])


@pytest.mark.slow
def test_the_map_that_is_written_takes_the_zero_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    joint = load_robot("1r").joints[0]
    logs = " ".join(str(shifted(Path(f"{seed}.csv"), seed)) for seed in (1, 2, 3))
    Path("map.toml").write_text(
        f'q_{joint} = {{ column = "pos", unit = "deg" }}\nq_des_1 = "goal"\n[units]\nq_des = "deg"\n'
    )
    assert run(f"identify 1r {logs} --columns map.toml -o first".split()) == 3
    said = capsys.readouterr().err
    assert f"{joint}: the recorded position" in said and 'column = "pos", offset = 0.6' in said
    (zero,) = zeros_of(Path("first"))
    assert zero["joint"] == joint and zero["zero"]["unit"] == "rad"
    assert zero["zero"]["value"] == pytest.approx(ZERO, abs=2.5 * zero["zero"]["std"])
    run(f"identify 1r {logs} --columns first/columns.toml -o second".split())
    assert "the recorded position" not in capsys.readouterr().err
    (zero,) = zeros_of(Path("second"))
    assert abs(zero["zero"]["value"]) < 0.1 and not Path("second/columns.toml").exists()


def test_a_file_of_the_user_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    logs = " ".join(str(shifted(Path(f"{seed}.csv"), seed)) for seed in (1, 2))
    Path("map.toml").write_text('q_1 = "pos"\nq_des_1 = "goal"\n[units]\nq = "deg"\nq_des = "deg"\n')
    Path("out").mkdir()
    Path("out/columns.toml").write_text("mine")
    assert run(f"identify 1r {logs} --columns map.toml -o out".split()) == 3
    assert Path("out/columns.toml").read_text() == "mine"
    notes = json.loads(Path("out/identification.json").read_text())["notes"]
    assert any("columns.toml is not written" in note for note in notes)


def test_signs_act_on_all_columns_of_a_joint_and_the_map_of_the_user_remains(tmp_path: Path) -> None:
    robot = load_robot("3r")
    one, two, three = robot.joints
    t = np.arange(50) / 50
    columns = {"q_A": t, "q_des_A": t + 0.1, "dq_A": 1 + t, f"q_{two}": 90 * t, f"q_{three}": t, "spare": t}
    pl.DataFrame({"stamp": 1e3 * t, **columns}).write_csv(tmp_path / "a.csv")
    given = {
        "t": {"column": "stamp", "unit": "ms"},
        f"q_{two}": {"column": f"q_{two}", "scale": 0.5, "offset": 0.1},
        "joints": {one: "A"},
    }
    kinds = {"q": ("q_A", f"q_{two}", f"q_{three}"), "q_des": ("q_des_A", "", ""), "dq": ("dq_A", "", "")}
    text = revised_map(given, robot.joints, kinds, {one: Turned(-1, 0.3), two: Turned(1, 0.2)})
    (tmp_path / "map.toml").write_text(text)
    read = read_recording(tmp_path / "a.csv", robot, columns=tmp_path / "map.toml").read()
    assert read.t == pytest.approx(t) and read.q_des is not None and read.dq is not None
    assert read.q == pytest.approx(np.column_stack([0.3 - t, 45 * t + 0.3, t]))
    assert read.q_des[:, 0] == pytest.approx(0.2 - t) and read.dq[:, 0] == pytest.approx(-1 - t)


def test_amperes_stay_amperes_and_what_has_no_sign_gets_none(tmp_path: Path) -> None:
    """A turned joint turns its signed current, in A; absolute values are read as before, whatever a map calls them."""
    robot = load_robot("3r")
    t = np.arange(50) / 50
    columns = {"q": np.column_stack([t, t, t]), "abs_current_1": 1 + t, "current_2": 2 + t, "strom": 3 + t}
    kinds = {"q": ("q_1", "q_2", "q_3"), "tau": ("abs_current_1", "current_2 [mA]", "strom")}
    given = {"abs_current_3": "strom", "units": {"abs_current": "mA"}}
    text = revised_map(given, robot.joints, kinds, dict.fromkeys(robot.joints, Turned(-1, 0.0)))
    assert "tau_" not in text and 'abs_current_3 = "strom"' in text and "abs_current_1" not in text
    assert f'current_{robot.joints[1]} = {{ column = "current_2 [mA]", scale = -0.001, offset = 0 }}' in text
    (tmp_path / "map.toml").write_text(text)
    spread = {f"q_{j + 1}": columns["q"][:, j] for j in range(3)} | {
        ("current_2 [mA]" if key == "current_2" else key): x for key, x in columns.items() if key != "q"
    }
    pl.DataFrame({"t": t, **spread}).write_csv(tmp_path / "a.csv")
    read = read_recording(tmp_path / "a.csv", robot, columns=tmp_path / "map.toml")
    assert read.signed.tolist() == [False, True, False] and read.scaled is not None and not read.scaled.any()
    assert read.read().tau[:, [1, 2]] == pytest.approx(np.column_stack([-0.001 * (2 + t), 0.001 * (3 + t)]))
    lying = revised_map({"tau_1": "abs_current_1"}, robot.joints, kinds, {robot.joints[0]: Turned(-1, 0.0)})
    assert 'tau_1 = "abs_current_1"' in lying and lying.count("abs_current_1") == 1


def test_a_sign_that_may_be_either_is_not_written(tmp_path: Path) -> None:
    def turned(joint: str, sign: int, probability: float) -> JointZero:
        return JointZero(joint, sign, probability, 0.3, 0.01, probability > 0.9, True, 0.99)

    zeros = (turned("a", -1, 0.52), turned("b", -1, 0.97), turned("c", 1, 0.52))
    log = SimpleNamespace(joints=("a", "b", "c"), columns={"q": ("q_a", "q_b", "q_c")})
    files, notes = revised_columns(SimpleNamespace(zeros=zeros), [log], None, str(tmp_path))  # type: ignore[arg-type]
    text = str(files["columns.toml"])
    assert "q_a" not in text and "q_b" in text and "scale = -1" in text and not notes
    assert 'q_c = { column = "q_c", scale = 1, offset = 0.3 }' in text  # the sign of the description stays
    first, second, _ = zero_flags(zeros, {})
    assert "probability 0.52" in first and "scale = -1," not in first and "no file states it" in first
    assert "scale = -1, offset = 0.3" in second
    files, _ = revised_columns(SimpleNamespace(zeros=zeros[:1]), [log], None, str(tmp_path))  # type: ignore[arg-type]
    assert not files
