"""Load of the last link, as the feasible difference of recordings without and with it."""

from .result import Payload
from .run import payload

__all__ = ["Payload", "payload"]
