"""One table says what each format holds: it is that of the README, and flags and notes of exports come from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from exported import executed, model_of
from servo_loops import SWING, driven

from signid.effects import EFFECTS, UNLISTED
from signid.effects.base import FUNCTIONS, TorqueLaw
from signid.output.export import KINDS, export
from signid.output.export.code.graph import BINARY, UNARY
from signid.output.export.formats import FORMATS, OF_VECTORS, VENDORS, among, held, writable
from signid.output.export.function import _code_of
from signid.types import Law

README = Path(__file__).parents[1] / "signid" / "output" / "README.md"
NAMES = [*EFFECTS.names, *UNLISTED.split()]
COLUMNS = [kind for kind in KINDS if kind not in (*VENDORS, "arrays")]  # arrays are as c
SIGNS = {"exact": "x", "approximate": "~", "": ""}


def table() -> str:
    rows = [["law", *COLUMNS], ["---"] * (len(COLUMNS) + 1)]
    rows += [[f"`{name}`", *(SIGNS[FORMATS[kind].grade(name)] for kind in COLUMNS)] for name in NAMES]
    return "".join(f"| {' | '.join(row)} |\n".replace("  ", " ") for row in rows)


def test_the_readme_has_the_table() -> None:
    assert table() in README.read_text(), f"the table is\n{table()}"
    assert FORMATS["arrays"] is FORMATS["c"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_table_names_laws(kind: str) -> None:
    found = FORMATS[kind]
    exact, rough = set(found.exact.split()), set(found.approximate.split())
    assert exact | rough <= set(NAMES) and not exact & rough
    assert set(found.driven.split()) <= exact | rough and set(found.beside.split()) <= set(KINDS)


@pytest.mark.parametrize("name", NAMES)
def test_code_holds_the_laws_that_the_table_says(name: str) -> None:
    effect = EFFECTS[name]
    law = Law(effect, (0, 1) if effect.scope == "pair" else (0,), dict(effect.example))
    assert bool(FORMATS["function"].grade(name)) == (_code_of(law) is not None)
    bodies = ("payload", "link_inertia", "base_tilt", "gravity", "armature")
    assert bool(FORMATS["c"].grade(name)) == (writable(law) or name in bodies)


def test_code_has_every_name_that_an_equation_may_use() -> None:
    class Added(TorqueLaw):
        name = "added"
        equation = "where(v > 0, clip(q, -1, 1) * pi, minimum(a, arctan(load)))"

    law = Law(Added(), (0,))
    model = replace(model_of("3r"), laws=(law,))
    assert writable(law) and {*UNARY, *BINARY} | {"pi", "clip", "where", "sum", "interp"} >= {*FUNCTIONS} - OF_VECTORS
    assert all(among(law, held(model, kind)) for kind in ("c", "arrays", "function"))
    assert "3.14159" in export(model, "c").text


def test_a_law_with_much_of_the_torque_is_a_flag() -> None:
    (flag,) = export(model_of("3r", "torque_offset@2:offset=1"), "urdf").flags
    assert flag.startswith("a URDF cannot hold torque_offset of joint_2: ")
    assert " % of the torque of joint_2 along a simulated motion; held by mjcf, actuators, " in flag


def test_a_law_with_little_of_the_torque_is_a_note() -> None:
    made = export(model_of("3r", "torque_offset@2:offset=0.01", "torque_saturation@1"), "urdf")
    assert made.flags == ()
    assert made.notes == (
        "a URDF cannot hold torque_offset of joint_2, below 2 % of the torque",
        "a URDF cannot hold torque_saturation of joint_1, whose share of the torque is unknown",
    )
    assert f"<!-- {made.notes[0]}\n{made.notes[1]} -->" in made.text


def test_a_law_that_a_file_beside_it_holds_is_a_note() -> None:
    model = model_of("3r", "torque_offset@2:offset=1")
    made = export(model, "urdf", beside=["urdf", "function"])
    assert made.flags == () and made.notes == ("a URDF cannot hold torque_offset of joint_2, held by function",)


def test_newton_gets_joints_and_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    curved = SWING.with_(law="torque_speed", effort_limit=1.0, speed_limit=6.0)
    made = export(driven("3r", {"joint_1": SWING, "joint_3": curved}), "newton")
    space = executed(made.text, "newton.actuators", monkeypatch)
    added = list[dict[str, Any]]()
    builder = SimpleNamespace(
        joint_label=["arm/joint_1", "arm/joint_2", "arm/joint_3", "arm/flange"],
        joint_qd_start=[6, 7, 8, 9],
        add_actuator=lambda drive, **numbers: added.append(numbers),
        **{f"joint_{key}": [5.0] * 9 for key in ("target_ke", "target_kd", "armature", "damping", "friction")},
    )
    space["add_actuators"](builder)
    first, free, last = added
    assert (first["index"], first["kp"], first["kd"], first["const_effort"]) == (6, 8.0, 0.15, -0.05)
    assert first["delay_steps"] == 3 and first["clamping"] is None
    assert (free["kp"], free["delay_steps"], free["clamping"][0][1]) == (0.0, None, {"max_effort": 20.0})
    assert last["clamping"][0][1] == {"saturation_effort": 1.0, "velocity_limit": 6.0}
    assert builder.joint_armature[6] == 0.004 + 0.0025 * 0.15 and builder.joint_friction[6] == 0.08
    assert builder.joint_target_ke[6:] == [0.0, 0.0, 0.0] and builder.joint_target_ke[:6] == [5.0] * 6
    assert any("command_delay of joint_1, joint_3" in note and note.endswith("approximately") for note in made.notes)
