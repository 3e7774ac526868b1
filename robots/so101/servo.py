"""Identify the position drive of the wrist of an SO-101 arm from commands and positions; no torque is recorded.

The recording is one minute of a real arm at 50 Hz (LeRobot SO-101, Feetech STS3215). Zero and sign of its positions
against the URDF are not established, so its masses do not set the scale here: lag and ratios of the drive are
identifiable, its gain in N.m/rad is not, and the result says so.
"""

from pathlib import Path

import signid
from signid.servo.identify import ServoIdentification, ServoOptions

HERE = Path(__file__).parent
HELD_OUT_RMS = 0.004  # rad, upper bound, from this example
LAG = (0.04, 0.12)  # s


def main() -> ServoIdentification:
    """Identify the drive, and compare its simulation with the held-out last 30 % of the recording."""
    robot = signid.load_robot(HERE / "arm.urdf")
    recording = signid.read_recording(HERE / "recording.csv.gz", robot)
    result = signid.identify_servos(robot, recording, known="nothing", options=ServoOptions(additional=()))
    (wrist,), loop = result.joints, result.rollout
    print(f"{wrist.joint}: law {wrist.law}")
    for number in wrist.numbers.values():
        if number.value is None:
            print(f"  {number.name:18} -")
        else:
            interval = "" if number.std is None else f" +- {1.96 * number.std:.2g}"
            print(f"  {number.name:18} {number.value:.4g}{interval} {number.unit}")
    for sentence in wrist.not_identifiable:
        print(sentence)
    rms, without = 1e3 * loop.whole_rms[0], 1e3 * loop.nominal_whole_rms[0]
    print(f"held out, simulated from commands alone: rms {rms:.1f} mrad; q = q_des: {without:.1f} mrad")
    if loop.whole_rms[0] > HELD_OUT_RMS:
        raise SystemExit(f"the held-out rms is above {HELD_OUT_RMS} rad")
    lag = wrist.numbers["lag"].value
    if lag is None or not LAG[0] < lag < LAG[1]:
        raise SystemExit(f"the lag is not between {LAG[0]} and {LAG[1]} s")
    return result


if __name__ == "__main__":
    try:
        main()
    except signid.SignidError as error:
        raise SystemExit(str(error)) from None
