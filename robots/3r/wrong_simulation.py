"""My simulation is wrong: where it differs from the robot, which physics it lacks, and what nobody can tell as yet.

The simulation here is `3r`, as its URDF describes it. The robot is a simulation, too, with physics concealed in it that
the diagnosis is not told: it sees the URDF and recordings, and nothing else. Run it: it takes some seconds. The same on
the command line, given the recordings:

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


# Step 1. The robot does its work, some small slow motion, and is recorded: encoders of 17 bits, 2 % of torque noise.
# `signid simulate 3r --motion motion.csv --inject LAW` does the same; `signid effects` lists the laws.
def record(motion: Trajectory, seed: int) -> Recording:
    """A recording of the robot, concealed physics and all."""
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

# Step 2. Check first. Had a joint been mixed up, a sign turned round or a unit wrong, it would be said here, and
# nothing that follows would mean anything. Two things are said. The motion is too poor to identify every inertia; we
# need not, the simulation states them. And the torque of joint_3 does not follow from the description: either the
# column is not what we think it is, or physics is missing. We trust the column, so we go on.
checked = signid.check(robot, [recording])
print("check:", *checked.flags or ("nothing to complain of",), sep="\n  ")

# Step 3. Diagnose. Each of some thirty laws is tried at each joint, several together. What comes back is not a better
# fit but names, numbers and where they act. A cause has a probability, and alternatives that explain the same.
found = signid.diagnose(simulation, [recording])
for place in found.located:
    print(f"{robot.joints[place.joint]}: the difference depends on {place.variable} most, {place.explained:.0%} of it")


def tell(found: Diagnosis) -> None:
    """The causes, their numbers, and what would explain the recordings as well."""
    for finding in found.causes:
        at = " and ".join(robot.joints[j] for j in finding.law.joints)
        numbers = ", ".join(f"{k} {x:.3f} ± {1.96 * finding.std[k]:.3f}" for k, x in finding.law.parameters.items())
        print(f"  {finding.law.effect.name} of {at}: {numbers}; probability {finding.probability:.3f}")
        for other in [other for other in finding.alternatives if other.probability > 0.01]:
            print(f"    or {other.law.effect.name}, probability {other.probability:.3f}: {other.separating_motion}")


print("missing, as far as this recording tells:")
tell(found)

# Step 4. What cannot be told. Within 0.3 rad a spring and a weight or gas spring at a lever (counterbalance) pull
# alike: nobody can decide from this recording, and the likelier name may be the wrong one. Another motion can: it is
# made for the purpose, and goes far enough. (Of some pairs it says that no motion can; then another sensor has to.)
spring, lever = (parse_law(f"{name}@joint_3", robot, partial=True) for name in ("spring", "counterbalance"))
apart = signid.separate(simulation, spring, lever, duration=10)
reach = apart.trajectory.q[:, 2]
print(f"\na motion that decides takes joint_3 from {reach.min():.1f} to {reach.max():.1f} rad")
second = record(apart.trajectory, seed=2)
surely = signid.diagnose(simulation, [second], held_out=[recording])  # learn from the new one, judge by the old one
print("missing, now that the robot has moved that way:")
tell(surely)
print(f"verdict: {surely.verdict}; flags: {'; '.join(surely.flags) or 'none'}\n")

# Step 5. Proof. The `model` of what was found is the simulation with what it lacked. Simulated for half a second at a
# time, from measured states, under the torque of the recording that it did not learn from: does it stay with the robot?
found = surely
before, after = (signid.roll_out(model, [recording], horizons=(0.5,)).rms(0.5) for model in (simulation, found.model))
for joint, was, is_now in zip(robot.joints, before, after, strict=True):
    print(f"{joint}: position after 0.5 s off by {was:.4f} rad before, {is_now:.4f} rad with what was missing")

# Step 6. See it: a replay, with the simulation as a ghost beside the robot, the findings marked at their joints, and a
# switch between before and after; and a report of all that was found. And use it, in MuJoCo or elsewhere. What a format
# cannot hold is said; laws that MJCF does not know are a function torque(q, v, a, mjcf=True) that needs numpy alone.
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
# 1. Your URDF, xacro or MJCF file instead of "3r"; what it states of damping and friction counts. Drives go into
#    actuators.toml beside it, and belong to the simulation as well:
#        [joint.elbow]
#        torque_constant = 11.4  # N.m/A at the joint; also armature, viscous_friction, coulomb_friction, torque_offset
# 2. Other names of columns: a file columns.toml with lines such as q_elbow = "elbow_pos", given by --columns.
# 3. signid diagnose my_arm.urdf log.csv --held-out another.csv --columns columns.toml -o diagnosis
#    It ends with 3 where a cause is one of several, or unknown. --reference takes a recording of the robot when all was
#    well, --skip a law that cannot be. diagnosis/model.json simulates and is diagnosed again.
