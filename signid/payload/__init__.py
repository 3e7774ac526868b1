"""Load of the last link, as the feasible difference of recordings without and with it, or of parts of one recording."""

from .carried import Load, carried, with_payload
from .run import payload
from .weigh import LoadMoment, Payload

__all__ = ["Load", "LoadMoment", "Payload", "carried", "payload", "with_payload"]
