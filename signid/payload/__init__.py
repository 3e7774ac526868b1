"""Load of the last link, as the feasible difference of recordings without and with it, or of parts of one recording."""

from .result import LoadMoment, Payload
from .run import payload

__all__ = ["LoadMoment", "Payload", "payload"]
