"""Load of the last link, as the feasible difference of recordings without and with it."""

from .run import Payload, payload

__all__ = ["Payload", "payload"]
