"""Link encoder: a drive that measures the position behind the backlash of its gear."""

from ..types import Array, Shape
from .drive import DriveLaw, DriveState


class LinkEncoder(DriveLaw):
    """A drive measures and damps the link behind backlash with side 1, the motor with side 0."""

    name, equation = "link_encoder", "error"
    source = "Nordin, Gutman, Controlling mechanical systems with backlash, Automatica 38(10), 2002, section 2"
    headline = "encoder on the link of {joint}, behind its gear: {side}"
    typical = "1 for servos with an encoder on the output shaft, 0 for robots with encoders on the motors"
    parameters = {"side": Shape("1", ())}
    example = {"side": 1.0}
    stage, numbers = "error", {"side": "link_encoder"}

    def acts(self, x: DriveState, side: float) -> Array:
        return x.error


PLUGIN = LinkEncoder()
