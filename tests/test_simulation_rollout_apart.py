"""A roll-out in which a robot flies apart ends with infinite errors, not with a fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signid


@pytest.mark.parametrize("step", [1e-3, 4e-3])
def test_a_light_hand_whose_fingers_follow_each_other_flies_apart(step: float) -> None:
    panda, t = signid.load_model("panda"), 4e-3 * np.arange(500)
    columns = {f"q_{j + 1}": 0.3 * np.sin(2 * t + j) for j in range(8)}
    torque = {f"tau_{j + 1}": 50 * np.cos(3 * t) for j in range(8)}
    heard = signid.read_recording({"t": t, **columns, **torque}, panda.robot)
    light = replace(panda, inertials=1e-3 * panda.inertials)
    found = signid.roll_out(light, heard, (0.5,), windows=3, step=step)
    assert not np.isnan(found.error).any() and np.isinf(found.rms(0.5)).all()
