"""The load of the last link, as the feasible difference of recordings without it and with it."""

from .result import Payload
from .run import payload

__all__ = ["Payload", "payload"]
