"""Forward dynamics with laws: a plant, what moves it, and what is recorded of it."""

from .control import Torques as Torques
from .control import track as track
from .given import read_motion as read_motion
from .given import recorded_torques as recorded_torques
from .run import Simulation as Simulation
from .run import simulate as simulate
from .run import simulate_many as simulate_many
from .sensors import Sensors as Sensors
from .sensors import record as record
