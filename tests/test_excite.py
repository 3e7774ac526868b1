"""Exciting motions obey every limit and tell more than random ones."""

import numpy as np
import pytest

from signid.errors import OptionError
from signid.excite import build_limits, excite
from signid.model import load_model


def test_a_pendulum_is_excited_within_its_limits() -> None:
    found = excite(load_model("1r"), duration=5.0)
    assert found.use.largest <= 0.95 + 1e-9
    assert np.allclose([found.trajectory.v[[0, -1]], found.trajectory.a[[0, -1]]], 0, atol=1e-9)
    assert np.isfinite(found.std).all()


def test_impossible_wishes_get_a_sentence() -> None:
    model = load_model("1r")
    for wish in ({"kind": "walk"}, {"criterion": "beauty"}, {"duration": 2.0, "base_frequency": 0.1}):
        with pytest.raises(OptionError):
            excite(model, **wish)
    for limit in ({"lower": 1, "upper": 1}, {"velocity": 0}, {"torque": [1, 2]}):
        with pytest.raises(OptionError):
            build_limits(model.robot, **limit)
