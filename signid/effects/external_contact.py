"""External contact: a force on the last link during a time window."""

from collections.abc import Iterator

import numpy as np

from ..types import Array, Coefficient, Shape, View
from .base import TorqueLaw

WINDOW_LENGTHS, WINDOW_STEP = (0.5, 1.0, 2.0), 0.25  # [s] lengths of the candidate windows; step between their starts


class ExternalContact(TorqueLaw):
    """Force exerted by the robot at the centre of mass of the last link, constant in world axes."""

    name = "external_contact"
    equation = "jacobian.T @ array([force_x, force_y, force_z]) * (start <= t <= end)"
    source = (
        "Haddadin, De Luca, Albu-Schaffer, Robot collisions: a survey, IEEE Trans. Robotics 33(6), 2017, section II"
    )
    headline = "an external contact from {start} to {end}: {force}"
    typical = "5 to 50 N, for tenths of a second or longer"
    parameters = {
        **{f"force_{axis}": Coefficient("N") for axis in "xyz"},
        **{key: Shape("s", (), positive=False) for key in ("start", "end")},
    }
    example = {"force_x": 10.0, "force_y": -8.0, "force_z": 12.0, "start": 2.0, "end": 3.0}
    scope, approximate = "robot", True

    def columns(self, x: View, start: float, end: float) -> list[Array]:
        return [((x.t >= start) & (x.t <= end)) * x.whole.jacobian[..., axis, :] for axis in range(3)]

    def shapes(self, x: View) -> Iterator[dict[str, float]]:
        first, last = float(x.t.min()), float(x.t.max())
        for width in WINDOW_LENGTHS:
            yield from ({"start": s, "end": s + width} for s in np.arange(first, last - width, WINDOW_STEP).tolist())


PLUGIN = ExternalContact()
