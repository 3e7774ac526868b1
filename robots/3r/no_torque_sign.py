"""My robot has no torque sign: many drives log the size of torque or current, and not its direction.

signid finds the signs, says how sure each is, and goes on as if they had been measured. Run it: it takes some seconds.
Here the recording of `3r` has its signs thrown away, so that what is found can be held against what is true. The same
on the command line (with columns abs_tau_J or abs_current_J leave --unsigned out):

    signid identify 3r recording.parquet --unsigned --held-out held_out.parquet -o result
"""

from pathlib import Path

import numpy as np

import signid

HERE = Path(__file__).parent

# Step 1. A recording without signs. Columns are then called abs_tau_J instead of tau_J. `unsigned=True` forgets the
# signs of a recording that has them: a good way to find out whether your motion would do.
robot = signid.load_robot("3r")
known = signid.read_recording(HERE / "recording.parquet", robot)
lost = signid.read_recording(HERE / "recording.parquet", robot, unsigned=True)
judge = signid.read_recording(HERE / "held_out.parquet", robot)  # with its signs: the honest judge
print(f"recorded torque: {known.read(0, 1).tau.round(3)[0]} N.m")
print(f"without signs:   {lost.read(0, 1).tau.round(3)[0]} N.m\n")

# Step 2. Identify as usual. First the recording is cut into segments: stretches in which a joint moves and its torque,
# above a threshold, keeps one sign. Then the signs of all segments are searched together. Three things decide: friction
# brakes, inertia is positive, and joints feel each other.
result = signid.identify(robot, [lost], held_out=[judge])
signs = result.signs
assert signs is not None  # None only where every torque had its sign
print("joint    segments   +   -  lowest confidence")
for joint, name in enumerate(robot.joints):
    mine = signs.of(joint)
    plus = sum(segment.sign > 0 for segment in mine)
    lowest = min(segment.confidence for segment in mine)
    print(f"{name}  {len(mine):8}  {plus:2}  {len(mine) - plus:2}  {lowest:.6f}")

# Step 3. Can they be trusted? There are three safeguards, and each says something else:
#   the proof       no other choice of signs fits this model better;
#   the confidence  the probability that the sign of a segment is right, given the noise and this model;
#   the flags       that the model is wrong, or that the motion leaves a choice: then confidences mean little.
# Only where all three are good may signs count as measured. A flag also makes the command line end with code 3.
print(f"\nproved: {signs.proof.optimal}; flags: {'; '.join(signs.flags) or 'none'}; certain: {signs.is_certain()}")

# Step 4. Here we know the truth, so let us look.
times, torque = known.read().t, known.read().tau
right = [
    np.sign(np.mean(torque[(times >= segment.start) & (times <= segment.end), segment.joint])) == segment.sign
    for segment in signs.segments
]
print(f"{sum(right)} of {len(right)} segments have their true sign")

# Step 5. What does it cost to have lost the signs? Compare with the identification that had them.
signed = signid.identify(robot, [known], held_out=[judge])
change = np.abs(result.base_value - signed.base_value) / signed.estimate.std
print(f"base parameters differ by {np.median(change):.2f} standard deviations, at most {change.max():.2f}")
for joint, with_signs, without in zip(robot.joints, signed.fit.held_out_r2, result.fit.held_out_r2, strict=True):
    print(f"{joint}: held-out R2 {without:.5f} without signs, {with_signs:.5f} with them")

# Step 6. When does it go wrong? Where the motion tells too little: here the same arm for two seconds. signid does not
# guess in silence, it says what is not decided, and what would decide it.
first = lost.read(0, 500)
columns = {"t": first.t} | {f"q_{j}": first.q[:, j - 1] for j in (1, 2, 3)}
columns |= {f"abs_tau_{j}": first.tau[:, j - 1] for j in (1, 2, 3)}  # a recording may be a dict of arrays
short = signid.identify(robot, [signid.read_recording(columns, robot)], held_out=[judge])
print("\ntwo seconds only:")
for flag in short.flags:
    print(f"  {flag}")

# With your own robot
# 1. Name the columns abs_tau_J [N.m] or abs_current_J [A], or map other names in a file columns.toml (--columns):
#        abs_current_elbow = "elbow_load"
#    Log the absolute value unfiltered: a filter fills the dips at which the sign changes.
# 2. Currents need the torque constant, in actuators.toml beside the URDF. Without one it is searched for, and flagged
#    or refused where it stays uncertain:
#        [joint.elbow]
#        torque_constant = 11.4  # N.m/A at the joint
# 3. Joints that do log a sign keep their tau_J column: they help to find the signs of the others.
# 4. Move all joints, out of step, both ways and fast enough to be far from standing still for most of the time.
# 5. signid identify my_arm.urdf log.csv --columns columns.toml -o result
#    Then look at result/signs.html and use result/signed.csv: t, tau_J, and sure_J, how sure each sign is.
