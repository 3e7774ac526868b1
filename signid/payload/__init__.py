"""Load of the last link, as the feasible difference of recordings without and with it, or of parts of one recording."""

from .run import payload
from .weigh import Load, LoadMoment, Payload, carried, with_payload

__all__ = ["Load", "LoadMoment", "Payload", "carried", "payload", "with_payload"]
