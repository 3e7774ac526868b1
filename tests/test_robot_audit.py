"""Descriptions with faults that are known in advance, and sound ones that stay silent."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from signid.cli.run import run
from signid.robot import audit, load_robot, robot_from_text
from signid.types import Robot

ROBOTS = Path(__file__).parents[1] / "robots"
BODIES = (
    ("upper", (0.01, 0.02, -0.12), 1.1, (0.006, 0.0065, 0.0012)),
    ("fore", (0, 0.01, -0.1), 0.6, (2e-3, 2.1e-3, 4e-4)),
)


def arm(
    mass: float = 1,
    length: float = 1,
    centre: float = 1,
    inertia: float = 1,
    only: str = "",
    limit: str = "20",
    extra: str = "",
) -> Robot:
    """Two links whose numbers are multiplied by factors; `only` one of them, if it is named."""
    text = '<robot name="reach"><link name="base"/>'
    for link, place, weight, moments in BODIES:
        m, c, i = (mass, centre, inertia) if only in ("", link) else (1, 1, 1)
        xyz = " ".join(str(x * c) for x in place)
        own = " ".join(f'{key}="{x * i!r}"' for key, x in zip(("ixx", "iyy", "izz"), moments, strict=True))
        inertial = f'<origin xyz="{xyz}"/><mass value="{weight * m}"/><inertia {own}/>'
        text += f'<link name="{link}"><inertial>{inertial}</inertial></link>'
    for joint, before, link, z in (("shoulder", "base", "upper", 0.0), ("elbow", "upper", "fore", -0.28)):
        text += (
            f'<joint name="{joint}" type="revolute"><parent link="{before}"/><child link="{link}"/>'
            f'<origin xyz="0 0 {z * length}"/><axis xyz="0 1 0"/>{extra}'
            f'<limit lower="-2" upper="2" effort="{limit}" velocity="5"/></joint>'
        )
    return robot_from_text(text + "</robot>", "urdf", "reach")


@pytest.mark.parametrize(
    ("given", "what", "factor", "unit"),
    [
        ({"mass": 1e3}, "mass", 1e3, "in g;"),
        ({"inertia": 1e3}, "inertia", 1e3, "in g.m2;"),
        ({"inertia": 1e4}, "inertia", 1e4, "in kg.cm2;"),
        ({"inertia": 1e6}, "inertia", 1e6, "in kg.mm2;"),
        ({"inertia": 1e7}, "inertia", 1e7, "in g.cm2;"),
        ({"inertia": 1e9}, "inertia", 1e9, "in g.mm2;"),
        ({"centre": 1e3}, "centre", 1e3, "in mm;"),
    ],
)
def test_a_unit_is_named_and_the_bodies_are_corrected(
    given: dict[str, float], what: str, factor: float, unit: str
) -> None:
    found = audit(arm(**given))
    assert [(s.link, s.what, s.factor) for s in found.suspects] == [("upper", what, factor), ("fore", what, factor)]
    (sentence,) = found.before()
    assert "links upper, fore" in sentence and unit in sentence
    for mended, right in zip(list(found.robot.model.inertias)[1:], list(arm().model.inertias)[1:], strict=True):
        np.testing.assert_allclose(mended.toDynamicParameters(), right.toDynamicParameters(), rtol=1e-9, atol=1e-12)


def test_several_units_at_once_and_a_single_link() -> None:
    found = audit(arm(mass=1e3, centre=1e3, inertia=1e9))
    assert {(s.what, s.factor) for s in found.suspects} == {("mass", 1e3), ("centre", 1e3), ("inertia", 1e9)}
    assert len(found.before()) == 3
    assert [(s.link, s.factor) for s in audit(arm(inertia=1e6, only="fore")).suspects] == [("fore", 1e6)]


def test_lengths_in_millimetres_are_named() -> None:
    assert ("length", 1e3) in {(s.what, s.factor) for s in audit(arm(length=1e3)).suspects}


def test_placeholders_and_impossible_inertias_have_their_words() -> None:
    text = arm().document
    same = re.sub(r"<inertia [^/]*/>", '<inertia ixx="1" iyy="1" izz="1"/>', text)
    found = audit(robot_from_text(same, "urdf", "reach"))
    assert {s.what for s in found.suspects} == {"placeholder"} and "placeholders" in found.before()[0]
    flat = text.replace('izz="0.0004"', 'izz="0.0999"')
    assert ("fore", "impossible") in {(s.link, s.what) for s in audit(robot_from_text(flat, "urdf", "reach")).suspects}


def test_points_and_bodies_that_never_turn_may_have_any_inertia() -> None:
    point = re.sub(r"<inertia [^/]*/>", '<inertia ixx="0" iyy="0" izz="0"/>', arm().document)
    assert audit(robot_from_text(point, "urdf", "reach")).suspects == ()
    slide = re.sub(r"<inertia [^/]*/>", '<inertia ixx="1" iyy="1" izz="1"/>', arm().document)
    assert audit(robot_from_text(slide.replace("revolute", "prismatic"), "urdf", "reach")).suspects == ()


def test_limits_of_zero_are_one_sentence() -> None:
    found = audit(arm(limit="0"))
    (sentence,) = found.notes
    assert found.before() == () and {s.what for s in found.suspects} == {"effort"}
    assert sentence == "the effort limit of shoulder, elbow is stated as 0, which counts as none"


@pytest.mark.parametrize(
    "name", ["1r", "3r", "emps", "so101", "bam_xl330", "bam_sts3250", "panda", "ur10", "talos_reduced", "z1"]
)
def test_sound_robots_are_silent(name: str) -> None:
    assert audit(arm()).suspects == () and audit(load_robot(name)).suspects == ()


def test_known_defects_of_published_descriptions() -> None:
    ur5, baxter = audit(load_robot("ur5_robot")), audit(load_robot("baxter"))
    assert {s.link for s in ur5.suspects} == {"wrist_1_link", "wrist_2_link", "wrist_3_link"}
    assert len(ur5.before()) == 1
    assert any("same damping of 0.7" in note for note in baxter.notes)


def test_inspect_flags_the_description(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "arm.urdf"
    path.write_text(arm(inertia=1e6).document)
    assert run(["inspect", str(path), "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert [set(suspect) for suspect in found["suspect"]] == [{"link", "what", "factor", "sentence"}] * 2
    assert found["flags"] == [found["suspect"][0]["sentence"]] and found["suspect"][0]["factor"] == 1e6
    path.write_text(arm().document)
    assert run(["inspect", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["suspect"] == []


@pytest.mark.parametrize("effort", ["20", "0"])
def test_limits_of_zero_are_notes_of_check_and_identify(effort: str, tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    described = (ROBOTS / "3r" / "robot.urdf").read_text().replace('effort="20"', f'effort="{effort}"')
    (tmp_path / "robot.urdf").write_text(described)
    given = [str(tmp_path / "robot.urdf"), str(ROBOTS / "3r" / "recording.parquet"), "--json"]
    for verb in ("check", "identify"):
        assert run([verb, *given]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["flags"] == []
        assert any("is stated as 0" in note for note in found["notes"]) == (effort == "0")
        assert verb == "identify" or found["headline"].startswith("Good")
