"""Identify a Franka Panda from 21 s of exciting motion (Gaz et al., RA-L 2019) with link-side torque sensors.

`signid data panda` downloads the recording. The model has no armature: link-side sensors do not measure the rotors.
"""

from pathlib import Path

import signid
from signid.identify import Identification
from signid.recording.gallery import recordings

EFFECTS = ("viscous_friction", "coulomb_friction", "torque_offset")
HELD_OUT_R2 = (0.997, 0.999, 0.999, 0.990, 0.996, 0.999, 0.968)  # lower bounds on the last 30 %, from this example


def main() -> Identification:
    """Identify and hold out the last 30 %."""
    robot = signid.load_robot(Path(__file__).with_name("arm.urdf"))
    recording = signid.read_recording(recordings("panda") / "exciting_traj_1.csv.gz", robot)
    result = signid.identify(robot, [recording], options=signid.Options(effects=EFFECTS))
    for joint, r2, least in zip(robot.joints, result.fit.held_out_r2, HELD_OUT_R2, strict=True):
        print(f"{joint:14} held-out R2 {r2:.4f}")
        if r2 < least:
            raise SystemExit(f"{joint}: held-out R2 is below {least}")
    return result


if __name__ == "__main__":
    try:
        main()
    except signid.SignidError as error:
        raise SystemExit(str(error)) from None
