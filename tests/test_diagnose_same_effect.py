"""Several stated laws of one effect at one joint: each can be found changed."""

from __future__ import annotations

from dataclasses import replace

import pytest

import signid
from signid.diagnose.data.hypotheses import propose
from signid.diagnose.extend import extended_laws
from signid.effects import EFFECTS
from signid.model import Model, load_model
from signid.regression.motion import Motion
from signid.simulation.excite.families import rest_to_rest_motion
from signid.simulation.plant import Sensors, record, simulate, track
from signid.types import Law


def ripple(amplitude: float, frequency: float, phase: float = 0.3) -> Law:
    return Law(EFFECTS["torque_ripple"], (1,), {"amplitude": amplitude, "frequency": frequency, "phase": phase})


def model(*laws: Law) -> Model:
    known = load_model("3r")
    return Model(known.robot, known.inertials, (*known.laws, *laws))


def test_each_stated_law_has_a_hypothesis_of_its_own() -> None:
    first, second = ripple(1.5, 9.0), ripple(1.0, 23.0)
    given = model(first, second, ripple(0.5, 23.0))
    moved = rest_to_rest_motion(given.robot, 4.0, 0.01, 1)
    motion = Motion(given.robot, moved.t, moved.q, moved.v, moved.a)
    torque = given.inverse(motion)
    found = propose(given, replace(motion, recorded=torque, predicted=torque))
    stated = {x.key: x.stated for x in found if x.stated is not None}
    assert stated == {("torque_ripple", (1,)): first, ("torque_ripple 2", (1,)): second}
    assert {x.kind for x in found if x.key[0].startswith("torque_ripple")} == {"torque_ripple"}
    assert {name for x in found if x.stated is second for name in x.names} == {("torque_ripple 2", (1,))}


def test_a_change_of_a_stated_wave_becomes_one_law_with_it() -> None:
    total, other = extended_laws([ripple(1.5, 9.0), ripple(1.0, 23.0)], [ripple(2.5, 9.0)])
    assert total.parameters == pytest.approx({"amplitude": 4.0, "phase": 0.3, "frequency": 9.0}) and other == ripple(
        1.0, 23.0
    )
    (opposite,) = extended_laws([ripple(1.5, 9.0)], [ripple(1.0, 9.0, 0.3 + 3.141592653589793)])
    assert opposite.parameters["amplitude"] == pytest.approx(0.5)


def test_two_stated_ripples_are_both_found_changed() -> None:
    """A whole diagnosis, as only the search shows that both are selected."""
    true, stated = model(ripple(4.0, 9.0), ripple(3.0, 23.0)), model(ripple(1.5, 9.0), ripple(1.0, 23.0))
    asked = rest_to_rest_motion(true.robot, 8.0, 2e-3, 3)
    moved = simulate(true, track(true, asked), 8.0, step=2e-3)
    columns = record(true.robot, moved, Sensors(rate=125.0, noise=0.005), seed=3)
    found = signid.diagnose(stated, signid.read_recording(columns, true.robot))
    ripples = sorted(
        (x for x in found.findings if x.law.effect.name == "torque_ripple"), key=lambda x: x.law.parameters["frequency"]
    )
    assert [x.role for x in ripples] == ["cause", "cause"] and len(ripples) == len(found.findings)
    for one, amplitude, before in zip(ripples, (4.0, 3.0), (1.5, 1.0), strict=True):
        assert abs(one.law.parameters["amplitude"] - amplitude) < 0.05
        assert one.stated["amplitude"] == before and one.std["amplitude"] < 0.1 and one.std["phase"] < 0.05
    assert sum(x.effect.name == "torque_ripple" for x in found.model.laws) == 2
