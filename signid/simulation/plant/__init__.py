"""Forward dynamics with laws: plant, drives and sensors.

A drive moves a `signid.model.Model`: `track`, a controller that follows a motion, or given `Torques`. `simulate` gives
the signals of a perfect logger, `record` those of real encoders and amplifiers (`Sensors`). All laws of
`signid.effects` can act. Dry friction holds a joint exactly at rest.
"""

from .control import Torques, read_motion, recorded_torques, track
from .plant import Simulation, simulate
from .sensors import Sensors, record, record_held

__all__ = [
    "Sensors",
    "Simulation",
    "Torques",
    "read_motion",
    "record",
    "record_held",
    "recorded_torques",
    "simulate",
    "track",
]
