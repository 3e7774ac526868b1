"""Identify a Staubli TX40 from motor torques. The coupling of its wrist motors is not modelled: see joint 5.

`signid data tx40` downloads the recording.
"""

import signid
from signid.identify import Identification
from signid.recording.gallery import recordings

HELD_OUT_R2 = (0.98, 0.95, 0.97, 0.96)  # lower bounds for joints 1 to 4


def main() -> Identification:
    """Identify and hold out the last 30 %."""
    folder = recordings("tx40")
    robot = signid.load_robot(folder / "tx40.urdf")
    recording = signid.read_recording(folder / "exciting_traj.csv.gz", robot)
    result = signid.identify(robot, [recording])
    for joint, r2 in zip(robot.joints, result.fit.held_out_r2, strict=True):
        print(f"{joint:8} held-out R2 {r2:7.4f}")
    if any(r2 < least for r2, least in zip(result.fit.held_out_r2, HELD_OUT_R2, strict=False)):
        raise SystemExit("the held-out R2 of an uncoupled joint is below its bound")
    return result


if __name__ == "__main__":
    try:
        main()
    except signid.SignidError as error:
        raise SystemExit(str(error)) from None
