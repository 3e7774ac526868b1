"""Real recordings have no recording fault; exchanged wrists of a real robot are reported."""

from __future__ import annotations

from pathlib import Path

import pytest

import signid
from signid.faults import examine
from signid.model import Model, stated_inertials
from signid.regression.session import prepare

ACTUATORS = Path(__file__).parents[1] / "robots" / "ur10e" / "actuators.toml"

REAL = {
    "emps": ("emps_janot/emps.urdf", "emps_janot/emps_train", "emps_janot/emps_pulses"),
    "panda": ("panda_gaz2019/panda.urdf", "panda_gaz2019/exciting_traj_1"),
    "tx40": ("staubli_tx40/tx40.urdf", "staubli_tx40/exciting_traj"),
    "lwr4": ("kuka_lwr4_flobaroid/kuka_lwr4.urdf", *(f"kuka_lwr4_flobaroid/measurements_{k}" for k in (1, 2, 3))),
    "ur10e": (
        "ur10e_mamedov/ur10e.urdf",
        *(
            f"ur10e_mamedov/{name}"
            for name in (
                "identification_data__20_01_31_unload",
                "identification_data__20_02_12_40sec_12harm",
                "identification_data__20_02_19_14harm50sec",
                "identification_data__20_02_19_14harm50secLoad",
                "validation_data__20_01_17_ptp_10_points",
            )
        ),
    ),
}


@pytest.mark.slow_cases(but="emps|panda")
@pytest.mark.parametrize("name", REAL)
def test_real_recordings_pass(data: Path, name: str) -> None:
    described, *paths = REAL[name]
    robot = signid.load_robot(data / described, actuators=ACTUATORS if name == "ur10e" else None)
    for path in paths:
        recording = signid.read_recording(data / f"{path}.csv.gz", robot)
        session = prepare(robot, [recording], [recording])
        found = examine(Model(session.robot, stated_inertials(session.robot), ()), session)
        assert [f.sentence for f in found.findings if f.kind != "excitation"] == [], path
        assert ("excitation" in {f.kind for f in found.findings}) == (name == "lwr4")


def test_signless_hobby_servos_pass(data: Path) -> None:
    joints = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    robot = signid.load_robot(data / "so101_sage" / "so101.urdf", joints=joints)
    kinds = {"q": "q", "abs_tau": "tau_abs"}
    columns = {f"{a}_{name}": f"{b}_{k}" for k, name in enumerate(joints, 1) for a, b in kinds.items()}
    recording = signid.read_recording(data / "so101_sage" / "multisine.csv.gz", robot, columns=columns)
    session = prepare(robot, [recording], [recording])
    found = examine(Model(session.robot, stated_inertials(session.robot), ()), session)
    assert {f.kind for f in found.findings} <= {"excitation"}


@pytest.mark.slow_cases("4-5")
@pytest.mark.parametrize(("first", "second"), [(3, 4), (4, 5)])
def test_exchanged_wrists_of_a_real_robot_are_reported(data: Path, first: int, second: int) -> None:
    robot = signid.load_robot(data / "ur10e_mamedov" / "ur10e.urdf", actuators=ACTUATORS)
    path = data / "ur10e_mamedov" / "identification_data__20_02_12_50sec_12harm.csv.gz"
    rows = signid.read_recording(path, robot).read()
    tau = rows.tau.copy()
    tau[:, [first, second]] = rows.tau[:, [second, first]]
    recording = signid.read_recording({"t": rows.t, "q": rows.q, "tau": tau}, robot)
    session = prepare(robot, [recording], [recording])
    (finding,) = examine(Model(session.robot, stated_inertials(session.robot), ()), session).findings
    assert finding.kind == "torque order" and finding.joints == (robot.joints[first], robot.joints[second])
