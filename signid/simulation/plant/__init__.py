"""Forward dynamics with laws: a plant, what moves it, and what is recorded of it.

A `signid.model.Model` is moved by a drive: `track`, a controller that follows a motion, or `Torques` that are given.
`simulate` gives what a perfect logger would write, `record` what real encoders and amplifiers make of it (`Sensors`).
Every law of `signid.effects` can act. Friction holds a joint at rest exactly.
"""

from .control import Torques, track
from .inputs import read_motion, recorded_torques
from .run import Simulation, simulate, simulate_many
from .sensors import Sensors, record

__all__ = [
    "Sensors",
    "Simulation",
    "Torques",
    "read_motion",
    "record",
    "recorded_torques",
    "simulate",
    "simulate_many",
    "track",
]
