"""Tutorial: identify a dynamics model with intervals from a URDF and a recording. It runs in a few seconds.

The arm `3r` has three joints and is simulated in MuJoCo with encoder and torque noise. Link 3 weighs 10 % more than in
its URDF, and the URDF has no friction. Both are identified from the recording. The same on the command line:

    signid identify 3r recording.parquet --held-out held_out.parquet -o result
"""

import tomllib
from pathlib import Path

import signid

HERE = Path(__file__).parent

# Step 1. Load the description: a URDF, xacro or MJCF file, or a name. Torque does not depend on every inertial
# parameter: link 1 turns about a vertical axis, so its mass is unidentifiable. The base parameters are identifiable:
# combinations of masses, first moments (mass times centre of mass) and inertias. The following steps use them.
robot = signid.load_robot("3r")
inspected = signid.inspect(robot)
print(f"{robot.name}: joints {', '.join(robot.joints)}; {inspected.base.rank} base parameters")
print(f"unidentifiable: {', '.join(inspected.invisible[:4])} and {len(inspected.invisible) - 4} more\n")

# Step 2. Read the recording: a table with t [s], q_J [rad] and tau_J [N.m] for each joint J. Velocity and
# acceleration are optional: signid differentiates positions with a filter chosen from motion and noise.
recording = signid.read_recording(HERE / "recording.parquet", robot)
held_out = signid.read_recording(HERE / "held_out.parquet", robot)  # another motion, held out for validation
print(f"{len(recording)} training rows, {len(held_out)} held-out rows")

# Step 3. Check the recording before the fit. A flag names the problem and its remedy: a joint that did not move, a
# wrong sign, noise larger than the motion.
checked = signid.check(robot, [recording])
print(f"{checked.verdicts.count('identifiable')} of {len(checked.verdicts)} base parameters are identifiable")
print(f"flags: {'; '.join(checked.flags) or 'none'}\n")

# Step 4. Identify. Viscous and Coulomb friction, torque offset and rotor inertia (armature) of every joint are fitted
# together with the bodies.
result = signid.identify(robot, [recording], held_out=[held_out])
print(f"{'base parameter':63} value  ± (95 %)")
rows = zip(result.base.expressions, result.base_value, result.estimate.std, strict=True)
for expression, value, std in [row for row in rows if "_3" in row[0]][:5]:
    print(f"{expression:60} {value:8.4f}  {1.96 * std:.4f}")

# Step 5. Validate the model. Intervals cover noise, not missing physics, so look at the held-out torque: R2 near 1
# means that it is predicted. The residual should be near the noise floor, the noise of the torque measurement. Here
# it is larger because friction jumps at velocity reversals; elsewhere the two agree.
print("\njoint     held-out residual  noise floor  R2")
fit = result.fit
for joint, residual, floor, r2 in zip(fit.joints, fit.held_out_rms, fit.noise_floor, fit.held_out_r2, strict=True):
    print(f"{joint}  {residual:13.4f} N.m  {floor:7.4f} N.m  {r2:.4f}")
print(f"flags: {'; '.join(result.flags) or 'none'}")

# Step 6. Compare with the truth, which is known for a simulated arm. Coulomb friction is identifiable at each joint.
# The first moment of link 3 along x is a base parameter: 10 % larger than in the URDF.
truth = tomllib.loads((HERE / "truth.toml").read_text(encoding="utf-8"))
friction = {robot.joints[law.joints[0]]: law.parameters for law in result.model.laws if "coulomb" in law.effect.name}
for joint, numbers in friction.items():
    true = truth["joint"][joint]["coulomb_friction"]
    print(f"Coulomb friction of {joint}: {numbers['level']:.3f} N.m, truly {true:.3f}")
moment = dict(zip(result.base.expressions, result.base_value, strict=True))["mx_3"]
stated = robot.model.inertias[3].mass * robot.model.inertias[3].lever[0]
print(f"first moment of link 3: {moment:.4f} kg.m, truly {truth['link']['link_3']['first_moment'][0]}", end="; ")
print(f"in the URDF {stated:.4f}")

# Step 7. Export. The masses and inertias of the exported URDF reproduce the base parameters and are physically
# consistent. Unidentifiable parameters are taken from the given description.
print(f"\nphysically consistent inertials: {result.physically_consistent}")
urdf = signid.export(result.model, "urdf")
Path("identified.urdf").write_text(urdf.text, encoding="utf-8")
print("written: identified.urdf;", *urdf.notes)

# With your own robot
# 1. Use the path of your URDF instead of "3r". `signid inspect my_arm.urdf` prints joints and their numbers.
# 2. Name the columns t, q_J, tau_J (or current_J), or map other names in a file, one line per column:
#        q_elbow = "elbow_pos"
#    and pass the file: read_recording("log.csv", robot, columns="columns.toml"), or --columns columns.toml.
# 3. Currents need the torque constant, in actuators.toml next to the URDF (or by --actuators):
#        [joint.elbow]
#        torque_constant = 11.4  # N.m/A at the joint
# 4. Without a recording, `signid excite my_arm.urdf -o motion.csv` designs the most informative motion within limits.
# 5. signid identify my_arm.urdf log_1.csv log_2.csv --columns columns.toml -o result
