"""Forward dynamics with laws: a plant, what moves it, and what is recorded of it."""

from .control import Torques as Torques
from .control import track as track
from .run import Simulation as Simulation
from .run import simulate as simulate
from .run import simulate_many as simulate_many
