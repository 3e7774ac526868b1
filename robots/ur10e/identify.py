"""Identify a UR10e from motor currents (Mamedov et al., Frontiers in Robotics and AI, 2020); another day is held out.

`signid data ur10e` downloads the recordings. actuators.toml contains the torque constants.
"""

from pathlib import Path

import signid
from signid.identify import Identification
from signid.recording.gallery import recordings

ACTUATORS = Path(__file__).with_name("actuators.toml")
HELD_OUT_R2 = (0.991, 0.995, 0.997, 0.983, 0.972, 0.987)  # lower bounds, from this example


def main() -> Identification:
    """Identify from 30 s of motion and hold out 50 s of another."""
    folder = recordings("ur10e")
    robot = signid.load_robot(folder / "ur10e.urdf", actuators=ACTUATORS)
    names = ("20_02_10_30sec_12harm", "20_02_12_50sec_12harm")
    train, held_out = (signid.read_recording(folder / f"identification_data__{name}.csv.gz", robot) for name in names)
    result = signid.identify(robot, [train], held_out=[held_out])
    for joint, r2, least in zip(robot.joints, result.fit.held_out_r2, HELD_OUT_R2, strict=True):
        print(f"{joint:20} held-out R2 {r2:.4f}")
        if r2 < least:
            raise SystemExit(f"{joint}: held-out R2 is below {least}")
    return result


if __name__ == "__main__":
    try:
        main()
    except signid.SignidError as error:
        raise SystemExit(str(error)) from None
