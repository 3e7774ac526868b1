"""The screen, the page and the JSON of `signid check`, of recordings with torque and of position drives."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from servo_logs import DATA, PUBLIC, drive, negated, recording
from test_faults_gravity import moved, seen

import signid
from signid.check import Check, check
from signid.cli.run import run
from signid.faults import SAMPLE_KINDS
from signid.faults.channels import COLUMN_KINDS
from signid.faults.commands import audit_servos
from signid.faults.distortions import KINDS as DISTORTIONS
from signid.faults.examine import LIMITS
from signid.faults.search import CLAIMS
from signid.output.report.layout import share
from signid.output.report.results.check import (
    DESCRIPTION_FAULTS,
    SAMPLE_FAULTS,
    SEARCHED_FAULTS,
    TORQUE_FAULTS,
    audit_page,
    audit_summary,
    check_document,
    check_page,
    check_summary,
)
from signid.output.report.results.check_summary import unit_sentences
from signid.recording import read_bare

G, RATE = 9.81, 250.0
RECORDED = Path(__file__).parents[1] / "robots/3r/recording.parquet"
GAP = (8.0, 10.0)  # [s] rows that are taken out


@cache
def columns() -> dict[str, np.ndarray]:
    """Columns of the example recording of 3r: 24 s at 250 Hz."""
    return {name: column.to_numpy() for name, column in zip(*_frame(), strict=True)}


def _frame() -> tuple[list[str], list[pl.Series]]:
    frame = pl.read_parquet(RECORDED)
    return frame.columns, frame.get_columns()


@cache
def gapped() -> Check:
    t = columns()["t"]
    kept = (t <= GAP[0]) | (t >= GAP[1])
    robot = signid.load_robot("3r")
    return check(robot, [signid.read_recording({name: x[kept] for name, x in columns().items()}, robot)])


def test_numbers_of_a_recording_with_torque() -> None:
    summary, t = check_summary(gapped()), columns()["t"]
    [row] = summary.sampling.rows
    rows = int(np.sum((t <= GAP[0]) | (t >= GAP[1])))
    assert row == ("(arrays)", str(rows), "100 %", "22.0", "250.0", "250.0", "stamps, even", "1")
    assert summary.sampled == ("1 gap in time split the recording, the longest 2 s at t = 8 s",)
    for line, j in zip(summary.joints.rows, (1, 2, 3), strict=True):
        assert float(line[1]) == pytest.approx(np.ptp(columns()[f"q_{j}"]), rel=0.02)
        tau = columns()[f"tau_{j}"]
        assert float(line[3]) == pytest.approx(np.sqrt(np.mean(tau**2)), rel=0.1)
    assert summary.verdict == "good" and summary.headline.startswith("Good for identification: no fault found, ")
    assert summary.gravity.verdict == "agrees"
    assert summary.gravity.sentence.startswith("agrees with (0, 0, -9.81) m/s2 in the frame of base_link: ")
    assert not summary.faults and len(summary.clear) == len(SAMPLE_FAULTS) + len(TORQUE_FAULTS)


def test_content_below_the_rate_is_said() -> None:
    t = columns()["t"]
    new = np.arange(t[0], t[-1], 0.2 / RATE)
    robot = signid.load_robot("3r")
    log = {"t": new} | {name: np.interp(new, t, x) for name, x in columns().items() if name != "t"}
    found = check(robot, [signid.read_recording(log, robot)])
    [row] = check_summary(found).sampling.rows
    assert row[4:6] == ("1250", "250.0")
    assert "are interpolated from about 250 Hz" in check_summary(found).sampled[0]
    assert check_document(found)["recordings"][0]["content_rate"] == pytest.approx(250)


def test_another_gravity_is_the_headline() -> None:
    summary = check_summary(seen((0.0, -G, 0.0)))
    assert summary.verdict == "faulty" and summary.gravity.verdict == "differs"
    assert summary.headline == (
        "Usable once this is corrected: gravity acts along -y of base_link (0, -9.81, 0): the robot is mounted on its "
        "side"
    )
    assert [fault.kind for fault in summary.faults] == ["gravity"] and "other gravity" not in summary.clear


def test_torque_without_weight_has_a_headline_with_a_number() -> None:
    robot = signid.load_robot("3r")
    summary = check_summary(check(robot, moved(robot, (0.0, 0.0, 0.0))))
    assert re.search(r"carries no weight of the robot: .* explain \d+ % of the torque instead of", summary.headline)


def test_what_was_looked_for_names_every_kind_of_fault() -> None:
    kinds = [kind for group in (SAMPLE_FAULTS, TORQUE_FAULTS) for known in group.values() for kind in known]
    kinds += DESCRIPTION_FAULTS.values()
    others = {"gravity", "weight", "units", "gain", "unexplained torque", "absolute torque"}
    limits = {f"{kind} limit" for kind in LIMITS}
    assert sorted(kinds) == sorted({*SAMPLE_KINDS, *COLUMN_KINDS, *limits, *CLAIMS, *DISTORTIONS, *others})


def test_torque_without_a_sign_is_not_compared() -> None:
    robot = signid.load_robot("3r")
    summary = check_summary(check(robot, [signid.read_recording(RECORDED, robot, unsigned=True)]))
    assert summary.gravity.verdict == "not judged" and not set(summary.clear) & set(TORQUE_FAULTS)
    assert set(summary.clear) == set(SAMPLE_FAULTS)


def test_numbers_of_drives() -> None:
    log = drive()
    found = audit_servos(recording(log))
    summary, [one] = audit_summary(found), found.joints
    [row], [line] = summary.sampling.rows, summary.joints.rows
    assert row[1:] == ("3000", "100 %", "30.0", "100.0", "100.0", "stamps, even", "0")
    error = log["q_des_a"] - log["q_a"]
    assert one.error == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    speed = np.gradient(log["q_a"], log["t"])
    assert one.speed == pytest.approx(np.sqrt(np.mean(speed**2)), rel=0.05)
    assert line[0] == "a" and line[1] == f"{np.ptp(log['q_des_a']):.2f}"
    assert int(line[5].split(" ± ")[0]) == pytest.approx(1e3 * (0.03 + 2 * 0.9 / 25), abs=3)
    assert summary.verdict == "good" and summary.headline.endswith(
        f"tracking errors up to {share(one.error / one.range)} of the range (a: {one.error:.2g} rad)"
    )
    assert summary.gravity.verdict == "not judged" and summary.clear == SEARCHED_FAULTS
    assert summary.identifiable == ("drive", ("a",), (), ())


def test_breaks_of_drives_are_gaps_and_rows_without_a_command() -> None:
    log = drive()
    kept = (log["t"] < 5) | (log["t"] > 7)
    off = np.where((log["t"] > 15) & (log["t"] < 20), 0.0, 1.0)
    found = audit_servos(recording({name: x[kept] for name, x in {**log, "on_a": off}.items()}))
    [stretches] = found.stretches
    assert found.breaks == (2,)
    assert np.array(stretches) == pytest.approx(np.array([[0, 4.99], [7.01, 15], [20, 29.99]]))
    assert audit_summary(found).sampling.rows[0][2] == share(found.commanded[0] / kept.sum())


def test_a_fault_of_a_drive_is_the_headline() -> None:
    summary = audit_summary(audit_servos(recording(negated(drive(), "a"))))
    assert summary.verdict == "faulty"
    assert summary.headline.startswith("Usable once this is corrected: a moves against its command (correlation -1.00)")
    [fault] = summary.faults
    assert fault.joints == ("a",) and not summary.clear


@pytest.mark.parametrize("mode", ["torque", "drives"])
def test_files_of_a_check(
    mode: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if mode == "torque":
        words = ["check", "3r", str(RECORDED)]
    else:
        pl.DataFrame(drive(seconds=12)).write_csv("servo.csv")
        words = ["check", "servo.csv"]
    assert run([*words, "-o", "out"]) == 0
    assert "out/report.html" in capsys.readouterr().out
    page, document = (Path("out") / name for name in ("report.html", "check.json"))
    run([*words, "--json"])
    assert capsys.readouterr().out == document.read_text(encoding="utf-8")
    found = json.loads(document.read_text(encoding="utf-8"))
    assert found["schema"] == "signid.check/1" and found["verdict"] == "good"
    assert {use["signal"] for use in found["units"]} >= {"t", "q"}
    assert found["units"][0] == {
        **{"signal": "t", "columns": ["t"], "stated": None, "by": None, "unit": "s", "torque_constants": None}
    }
    assert set(found["gravity"]) == {"verdict", "sentence"} and found["faults"] == []
    assert found["identifiable"]["of"] == sum(
        len(found["identifiable"][key]) for key in ("identifiable", "weak", "unidentifiable")
    )
    assert found["recordings"][0]["breaks"] == 0
    text = page.read_text(encoding="utf-8")
    assert found["headline"] in text and "signid check" in text
    shown = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert "http://" not in shown and "https://" not in shown
    Path("out/check.json").write_text("{}")
    assert run([*words, "-o", "out"]) == 2
    assert "was not written by signid" in capsys.readouterr().err


def test_the_page_shades_omitted_rows() -> None:
    page = check_page(gapped())
    plots = [json.loads(x) for x in re.findall(r'<script type="application/json">(.*?)</script>', page)]
    over_time = [plot for plot in plots if "shapes" in plot["layout"]]
    assert len(over_time) == 3 and len(plots) == 9
    for plot in over_time:
        [shape] = plot["layout"]["shapes"]
        assert [shape["x0"], shape["x1"]] == pytest.approx(GAP, abs=0.03)
    assert signid.report(gapped()) == page


def test_names_of_joints_are_text_in_the_page() -> None:
    log = drive(seconds=12)
    name = "a<b>%{y}"
    found, units = read_bare({"t": log["t"], f"q_{name}": log["q_a"], f"q_des_{name}": log["q_des_a"]})
    page = audit_page(audit_servos(found, units))
    assert "a<b>" not in page and "a\\u003cb" not in page and "a&lt;b&gt;" in page


@pytest.mark.slow
@PUBLIC
def test_public_recordings_are_good() -> None:
    folder = DATA / "panda_gaz2019"
    robot = signid.load_robot(folder / "panda.urdf")
    summary = check_summary(check(robot, [signid.read_recording(folder / "exciting_traj_1.csv.gz", robot)]))
    assert summary.verdict == "good" and summary.gravity.verdict == "agrees" and not summary.faults
    currents = DATA / "ur10e_mamedov"
    robot = signid.load_robot(currents / "ur10e.urdf")
    logs = sorted(currents.glob("identification_data*.csv.gz"))
    summary = check_summary(check(robot, [signid.read_recording(log, robot) for log in logs]))
    assert summary.verdict == "limited" and summary.gravity.verdict == "agrees"
    assert any("times torque constants" in said for said in unit_sentences(summary.units))


def test_a_log_without_a_usable_stretch_has_a_page() -> None:
    log = drive(seconds=12)
    log["q_des_a"] = np.where(np.arange(len(log["t"])) % 10 < 5, log["q_des_a"], np.nan)
    found = audit_servos(recording(log))
    summary = audit_summary(found)
    assert summary.verdict == "unusable" and not summary.joints.rows and not summary.advice
    assert summary.headline.startswith("Not usable for identification of drives: no joint has a position and a command")
    assert summary.headline in audit_page(found)
