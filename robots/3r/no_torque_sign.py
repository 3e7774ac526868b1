"""Tutorial: identify a robot without torque signs. Many drives log the absolute value of torque or current only.

signid recovers the signs with their confidence and identifies the robot with them. It runs in some seconds. The signs
of the `3r` recording are removed, so that the recovered ones can be compared with the truth. The same on the command
line (omit --unsigned for columns abs_tau_J or abs_current_J):

    signid identify 3r recording.parquet --unsigned --held-out held_out.parquet -o result
"""

from pathlib import Path

import numpy as np

import signid

HERE = Path(__file__).parent

# Step 1. Read a recording without signs. Its columns are named abs_tau_J instead of tau_J. `unsigned=True` removes
# the signs of a signed recording, which shows whether a motion is sufficient.
robot = signid.load_robot("3r")
known = signid.read_recording(HERE / "recording.parquet", robot)
unsigned = signid.read_recording(HERE / "recording.parquet", robot, unsigned=True)
held_out = signid.read_recording(HERE / "held_out.parquet", robot)  # with its signs
print(f"recorded torque: {known.read(0, 1).tau.round(3)[0]} N.m")
print(f"without signs:   {unsigned.read(0, 1).tau.round(3)[0]} N.m\n")

# Step 2. Identify as usual. The recording is cut into segments: stretches in which a joint moves and its torque,
# above a threshold, keeps one sign. Then the signs of all segments are searched together. Three facts determine them:
# friction dissipates energy, inertia is positive, and the joints are coupled.
result = signid.identify(robot, [unsigned], held_out=[held_out])
signs = result.signs
assert signs is not None  # None only if all torques are signed
print("joint    segments   +   -  lowest confidence")
for joint, name in enumerate(robot.joints):
    segments = signs.of(joint)
    plus = sum(segment.sign > 0 for segment in segments)
    lowest = min(segment.confidence for segment in segments)
    print(f"{name}  {len(segments):8}  {plus:2}  {len(segments) - plus:2}  {lowest:.6f}")

# Step 3. Validate the signs by three criteria:
#   proof       no other choice of signs fits this model better;
#   confidence  probability that the sign of a segment is right, given the noise and this model;
#   flags       the model is wrong, or the motion leaves a choice: confidences are then unreliable.
# Use the signs like measured ones only if all three are satisfied. A flag also sets the exit code 3.
print(f"\nproved: {signs.proof.optimal}; flags: {'; '.join(signs.flags) or 'none'}; certain: {signs.is_certain()}")

# Step 4. Compare with the truth, which is known here.
times, torque = known.read().t, known.read().tau
right = [
    np.sign(np.mean(torque[(times >= segment.start) & (times <= segment.end), segment.joint])) == segment.sign
    for segment in signs.segments
]
print(f"{sum(right)} of {len(right)} segments have their true sign")

# Step 5. Compare with the identification from the signed recording.
signed = signid.identify(robot, [known], held_out=[held_out])
change = np.abs(result.base_value - signed.base_value) / signed.estimate.std
print(f"base parameters differ by {np.median(change):.2f} standard deviations, at most {change.max():.2f}")
for joint, with_signs, without in zip(robot.joints, signed.fit.held_out_r2, result.fit.held_out_r2, strict=True):
    print(f"{joint}: held-out R2 {without:.5f} without signs, {with_signs:.5f} with them")

# Step 6. The search fails if the motion is not informative enough, as in two seconds of this recording. A flag then
# names the undetermined signs and a remedy.
first = unsigned.read(0, 500)
columns = {"t": first.t} | {f"q_{j}": first.q[:, j - 1] for j in (1, 2, 3)}
columns |= {f"abs_tau_{j}": first.tau[:, j - 1] for j in (1, 2, 3)}  # a recording may be a dict of arrays
short = signid.identify(robot, [signid.read_recording(columns, robot)], held_out=[held_out])
print("\ntwo seconds only:")
for flag in short.flags:
    print(f"  {flag}")

# With your own robot
# 1. Name the columns abs_tau_J [N.m] or abs_current_J [A], or map other names in a file columns.toml (--columns):
#        abs_current_elbow = "elbow_load"
#    Log the absolute value unfiltered: a filter removes the dips at sign changes.
# 2. Currents need the torque constant, in actuators.toml next to the URDF. A missing one is estimated, and flagged or
#    refused if it remains uncertain:
#        [joint.elbow]
#        torque_constant = 11.4  # N.m/A at the joint
# 3. Keep the tau_J column of joints with signed torque: it helps to determine the signs of the others.
# 4. Move all joints, at different frequencies, in both directions and fast enough to be rarely near standstill.
# 5. signid identify my_arm.urdf log.csv --columns columns.toml -o result
#    Then inspect result/signs.html and use result/signed.csv: t, tau_J, and sure_J, the confidence of each sign.
