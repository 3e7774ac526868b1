"""Load of the last link, as the feasible difference of recordings without and with it, or of parts of one recording."""

from .carried import carried, with_payload
from .load import Load
from .result import LoadMoment, Payload
from .run import payload

__all__ = ["Load", "LoadMoment", "Payload", "carried", "payload", "with_payload"]
