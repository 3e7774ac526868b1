"""Identify my arm: from a URDF and a recording to a dynamics model with intervals. Run it: it takes a few seconds.

The arm here is `3r`, three joints, simulated in MuJoCo with encoder and torque noise. Link 3 weighs 10 % more than its
URDF says, and the URDF knows nothing of friction. That is what the recording has to tell. The same on the command line:

    signid identify 3r recording.parquet --held-out held_out.parquet -o result
"""

import tomllib
from pathlib import Path

import signid

HERE = Path(__file__).parent

# Step 1. The description: a URDF, xacro or MJCF file, or a name. Torque does not feel every inertial parameter: link 1
# turns about an upright axis, so nobody can tell its mass. What torque can tell are the base parameters: combinations
# of masses, first moments (mass times centre of mass) and inertias. All that follows is about them.
robot = signid.load_robot("3r")
told = signid.inspect(robot)
print(f"{robot.name}: joints {', '.join(robot.joints)}; {told.base.rank} base parameters")
print(f"no motion can tell {', '.join(told.invisible[:4])} and {len(told.invisible) - 4} more\n")

# Step 2. The recording: a table with t [s], q_J [rad] and tau_J [N.m] for each joint J. Velocity and acceleration are
# not needed: signid differentiates positions with a filter that it fits to motion and noise.
recording = signid.read_recording(HERE / "recording.parquet", robot)
judge = signid.read_recording(HERE / "held_out.parquet", robot)  # another motion, kept aside to judge by
print(f"{len(recording)} rows to learn from, {len(judge)} to judge by")

# Step 3. Is the recording any good? Ask before you believe anything fitted to it. A flag says what is wrong and what
# would help: a joint that did not move, a sign turned round, noise that hides the motion.
checked = signid.check(robot, [recording])
print(f"{checked.verdicts.count('identifiable')} of {len(checked.verdicts)} base parameters are well identifiable")
print(f"flags: {'; '.join(checked.flags) or 'none'}\n")

# Step 4. Identify. At every joint viscous and Coulomb friction, an offset of the torque and the rotor's inertia
# (armature) are fitted with the bodies.
result = signid.identify(robot, [recording], held_out=[judge])
print(f"{'base parameter':63} value  ± (95 %)")
rows = zip(result.base.expressions, result.base_value, result.estimate.std, strict=True)
for expression, value, std in [row for row in rows if "_3" in row[0]][:5]:
    print(f"{expression:60} {value:8.4f}  {1.96 * std:.4f}")

# Step 5. Is the model right? The interval of a number counts noise, not physics that is missing. So look at torque that
# was held out: R2 near 1 means that it is predicted. What is left should come near the noise floor, the noise of torque
# itself. It lies above it here because friction jumps where a joint turns round; elsewhere the two agree.
print("\njoint     left, held out  noise floor  R2")
fit = result.fit
for joint, left, floor, r2 in zip(fit.joints, fit.held_out_rms, fit.noise_floor, fit.held_out_r2, strict=True):
    print(f"{joint}  {left:10.4f} N.m  {floor:7.4f} N.m  {r2:.4f}")
print(f"flags: {'; '.join(result.flags) or 'none'}")

# Step 6. Because this arm is simulated we can compare with the truth. Coulomb friction is told at each joint by itself.
# The first moment of link 3 along x is one of the base parameters: 10 % more than in the URDF.
truth = tomllib.loads((HERE / "truth.toml").read_text(encoding="utf-8"))
friction = {robot.joints[law.joints[0]]: law.parameters for law in result.model.laws if "coulomb" in law.effect.name}
for joint, numbers in friction.items():
    true = truth["joint"][joint]["coulomb_friction"]
    print(f"Coulomb friction of {joint}: {numbers['level']:.3f} N.m, truly {true:.3f}")
moment = dict(zip(result.base.expressions, result.base_value, strict=True))["mx_3"]
stated = robot.model.inertias[3].mass * robot.model.inertias[3].lever[0]
print(f"first moment of link 3: {moment:.4f} kg.m, truly {truth['link']['link_3']['first_moment'][0]}", end="; ")
print(f"the URDF said {stated:.4f}")

# Step 7. The single masses and inertias of the URDF below reproduce the base parameters, and a real robot could have
# them. They are possible, not measured: what torque cannot tell is taken from the description you gave.
print(f"\na real robot could have these inertials: {result.physically_consistent}")
urdf = signid.export(result.model, "urdf")
Path("identified.urdf").write_text(urdf.text, encoding="utf-8")
print("identified.urdf is written;", *urdf.notes)

# With your own robot
# 1. Give the path of your URDF instead of "3r". `signid inspect my_arm.urdf` prints joints and their numbers.
# 2. Name the columns t, q_J, tau_J (or current_J), or say in a file what they are called, one line a column:
#        q_elbow = "elbow_pos"
#    and pass it: read_recording("log.csv", robot, columns="columns.toml"), on the command line --columns columns.toml.
# 3. Currents need the torque constant, in actuators.toml beside the URDF (or by --actuators):
#        [joint.elbow]
#        torque_constant = 11.4  # N.m/A at the joint
# 4. No recording yet? `signid excite my_arm.urdf -o motion.csv` makes the motion that tells most within the limits.
# 5. signid identify my_arm.urdf log_1.csv log_2.csv --columns columns.toml -o result
