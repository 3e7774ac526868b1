"""Tutorial: diagnose a wrong simulation: where it differs from the robot, which physics is missing, what is ambiguous.

The simulation is `3r` as its URDF describes it. The robot is a second simulation with concealed physics: the diagnosis
sees only the URDF and the recordings. It runs in some seconds. The same on the command line, given the recordings:

    signid check 3r recording.csv
    signid diagnose 3r recording.csv -o diagnosis
    signid excite 3r --separate spring@joint_3,counterbalance@joint_3 --duration 10 -o motion.csv
    signid diagnose 3r second.csv --held-out recording.csv -o diagnosis
    signid replay 3r recording.csv --diagnosis diagnosis/diagnosis.json --html replay.html
    signid export diagnosis/model.json --mjcf extended.xml --function laws.py
"""

from pathlib import Path

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.effects.naming import parse_law
from signid.model import Model
from signid.types import Recording, Trajectory

CONCEALED = ("counterbalance@joint_3:amplitude=0.5", "coulomb_friction@joint_1:level=0.5")  # N.m

simulation = signid.load_model("3r")
robot = simulation.robot


# Step 1. Record the robot during a small slow motion, with 17-bit encoders and 2 % torque noise.
# `signid simulate 3r --motion motion.csv --inject LAW` does the same; `signid effects` lists the laws.
def record(motion: Trajectory, seed: int) -> Recording:
    """Record the robot with its concealed physics."""
    concealed = [parse_law(text, robot) for text in CONCEALED]
    true = Model(robot, simulation.inertials, (*simulation.laws, *concealed))
    moved = signid.simulate(true, signid.track(simulation, motion), duration=motion.t[-1])
    sensors = signid.Sensors(rate=250, encoder_bits=17, noise=0.02)
    return signid.read_recording(signid.record(robot, moved, sensors, seed=seed), robot)


t = np.arange(0, 12, 0.01)
pace = 2 * np.pi * np.array([0.35, 0.25, 0.45])  # rad/s
phase = np.outer(t, pace)
work = Trajectory(robot.joints, t, 0.3 * np.sin(phase), 0.3 * pace * np.cos(phase), -0.3 * pace**2 * np.sin(phase))
recording = record(work, seed=1)

# Step 2. Check first. A swapped joint, a wrong sign or a wrong unit would be reported here and would invalidate all
# further steps. Two flags are raised. The motion is too poor to identify every inertia, which is not needed because
# the simulation states them. And the torque of joint_3 does not follow from the description: either the column is
# wrong, or physics is missing. The column is right, so continue.
checked = signid.check(robot, [recording])
print("check:", *checked.flags or ("no flags",), sep="\n  ")

# Step 3. Diagnose. Some thirty laws are tried at each joint, alone and combined. The result is the names of the missing
# laws, their parameters and joints. A cause has a probability and equivalent alternatives.
found = signid.diagnose(simulation, [recording])
for place in found.located:
    print(
        f"{robot.joints[place.joint]}: the difference depends mainly on {place.variable} ({place.explained:.0%} of it)"
    )


def print_causes(found: Diagnosis) -> None:
    """Print the causes, their parameters and their alternatives."""
    for finding in found.causes:
        at = " and ".join(robot.joints[j] for j in finding.law.joints)
        numbers = ", ".join(f"{k} {x:.3f} ± {1.96 * finding.std[k]:.3f}" for k, x in finding.law.parameters.items())
        print(f"  {finding.law.effect.name} of {at}: {numbers}; probability {finding.probability:.3f}")
        for other in [other for other in finding.alternatives if other.probability > 0.01]:
            print(f"    or {other.law.effect.name}, probability {other.probability:.3f}: {other.separating_motion}")


print("missing according to this recording:")
print_causes(found)

# Step 4. Resolve the ambiguity. Within 0.3 rad, a spring and a weight or gas spring at a lever (counterbalance) have
# nearly equal torque: this recording cannot distinguish them, and the more probable name may be wrong. A motion
# designed for this purpose can. (Some pairs cannot be distinguished by any motion; they need another sensor.)
spring, lever = (parse_law(f"{name}@joint_3", robot, partial=True) for name in ("spring", "counterbalance"))
apart = signid.separate(simulation, spring, lever, duration=10)
reach = apart.trajectory.q[:, 2]
print(f"\nthe discriminating motion takes joint_3 from {reach.min():.1f} to {reach.max():.1f} rad")
second = record(apart.trajectory, seed=2)
surely = signid.diagnose(simulation, [second], held_out=[recording])  # the first recording is held out
print("missing according to the second recording:")
print_causes(surely)
print(f"verdict: {surely.verdict}; flags: {'; '.join(surely.flags) or 'none'}\n")

# Step 5. Validate. The `model` of a diagnosis is the simulation extended by the missing laws. It is simulated for
# half a second from measured states, under the torque of the held-out recording, and compared with the robot.
found = surely
before, after = (signid.roll_out(model, [recording], horizons=(0.5,)).rms(0.5) for model in (simulation, found.model))
for joint, was, is_now in zip(robot.joints, before, after, strict=True):
    print(f"{joint}: position after 0.5 s error {was:.4f} rad before, {is_now:.4f} rad with the missing laws")

# Step 6. Export. The replay shows the simulation as a ghost next to the robot, the findings at their joints, and a
# switch between before and after; the report lists all findings. Notes list everything that a format cannot represent;
# laws missing in MJCF become a function torque(q, v, a, mjcf=True) that needs numpy only.
mjcf = signid.export(found.model, "mjcf")
written = {
    "replay.html": signid.replay(simulation, recording, found).page(),
    "report.html": signid.report(found),
    "extended.xml": mjcf.text,
    "laws.py": signid.export(found.model, "function").text,
}
for name, text in written.items():
    Path(name).write_text(text, encoding="utf-8")
print(f"\nwritten: {', '.join(written)}", *mjcf.notes, sep="\n  ")

# With your own robot
# 1. Use your URDF, xacro or MJCF file instead of "3r", with its damping and friction. Drives are stated in
#    actuators.toml next to it and are part of the simulation:
#        [joint.elbow]
#        torque_constant = 11.4  # N.m/A at the joint; also armature, viscous_friction, coulomb_friction, torque_offset
# 2. Map other column names in a file columns.toml with lines such as q_elbow = "elbow_pos", given by --columns.
# 3. signid diagnose my_arm.urdf log.csv --held-out another.csv --columns columns.toml -o diagnosis
#    The exit code is 3 if a cause is ambiguous or unknown. --reference takes a recording of the healthy robot, --skip
#    an impossible law. diagnosis/model.json can be simulated and diagnosed again.
