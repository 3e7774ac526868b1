"""Bad inputs of the commands that simulate and excite."""

from __future__ import annotations

from bad_input import Case
from swing import csv

MOTION = "t,q_1\n" + "".join(f"{0.1 * k},{0.01 * k * k}\n" for k in range(20))


def simulation(name: str, given: str, says: str, robot: str = "3r", **files: str) -> Case:
    named = {key.replace("_", "."): content for key, content in files.items()}
    return Case(name, f"simulate {robot} -o out.csv {given}", says, named)


def motion(name: str, content: str, says: str, robot: str = "1r") -> Case:
    return simulation(name, "--motion m.csv", says, robot, m_csv=content)


def injections() -> list[Case]:
    def injected(name: str, law: str, says: str) -> Case:
        return simulation(f"injected: {name}", f"--inject '{law}'", says)

    return [
        injected("unknown effect", "magic@2:level=1", "magic"),
        injected("nothing", "", "no effect named"),
        injected("no joint", "spring:stiffness=1,rest=0", "none is named"),
        injected("strange joint", "spring@elbow:stiffness=1,rest=0", "elbow"),
        injected("joint that is empty", "spring@:stiffness=1,rest=0", "cannot be read"),
        injected("a shape missing", "stribeck_friction@2:level=1", "velocity"),
        injected("stiffness zero", "joint_elasticity@2:stiffness=0", "positive"),
        injected("a strange number", "spring@2:stiffness=1,rest=0,colour=3", "colour"),
        injected("a word", "spring@2:stiffness=soft,rest=0", "not a number"),
        injected("no equals sign", "spring@2:stiffness,rest=0", "cannot be read"),
        injected("twice the same key", "spring@2:rest=1,rest=0", "cannot be read"),
        injected("infinity", "spring@2:stiffness=inf,rest=0", "inf"),
        injected("friction below zero", "coulomb_friction@2:level=-1", "positive"),
        injected("velocity zero", "stribeck_friction@2:level=1,velocity=0", "positive"),
        injected("a joint for the whole robot", "base_tilt@2:x=0,y=0", "without @2"),
        injected("payload at another joint", "payload@1:mass=1", "last"),
        injected("no partner", "channel_swap@2", "partner"),
        injected("itself as partner", "channel_swap@2:partner=2", "other than"),
        injected("a partner too many", "torque_sign@2:partner=3", "no partner"),
        injected("elastic without a rotor", "joint_elasticity@2:stiffness=3000", "armature@joint_2:inertia="),
        injected("an impossible body", "link_inertia@3:mass=1,first_moment_x=0.3", "mass matrix"),
    ]  # fmt: skip


def driving() -> list[Case]:
    still = csv({"t": [0.1 * k for k in range(20)], "q_1": [0.0] * 20, "tau_1": [1.0] * 20})
    return [
        simulation("sub-steps without end", "--substeps 1000000", "at most 200"),
        simulation("steps without end", "--step 1e-9", "5e+06"),
        simulation("missing motion", "--motion gone.csv", "gone.csv"),
        motion("motion without time", MOTION.replace("t,", "time,"), "not a motion"),
        motion("motion without positions", MOTION.replace("q_1", "speed"), "not a motion"),
        motion("motion of a strange joint", MOTION.replace("q_1", "q_elbow"), "elbow"),
        motion("motion of two rows", "\n".join(MOTION.split("\n")[:3]) + "\n", "2 rows"),
        motion("motion with a hole", MOTION.replace("0.01\n", "\n"), "row 2"),
        motion("motion in words", MOTION.replace("0.01\n", "up\n"), "up"),
        motion("motion back in time", MOTION.replace("0.2,", "0.05,"), "row 3"),
        simulation("torque and motion", "--motion m.csv --torque t.csv", "both", m_csv=MOTION, t_csv=MOTION),
        simulation("torque without torque", "--torque m.csv", "torque", "1r", m_csv=MOTION),
        simulation("torque without signs", "--torque t.csv", "sign", "1r", t_csv=still.replace("tau", "abs_tau")),
        simulation("gains for an open loop", "--torque t.csv --kp 3", "open loop", "1r", t_csv=still),
        simulation("gains by half", "--kp 3", "--kd"),
        simulation("gains for another robot", "--kp 3,4 --kd 1", "3 joints"),
        simulation("gains in words", "--kp firm --kd 1", "firm"),
        simulation("gains below zero", "--kp -3 --kd 1", "negative"),
        simulation("gains and bandwidth", "--kp 3 --kd 1 --bandwidth 2", "--bandwidth"),
        simulation("bandwidth zero", "--bandwidth 0", "positive"),
        simulation("bandwidth infinite", "--bandwidth inf", "finite"),
        simulation("feed-forward that is no number", "--feed-forward nan", "finite"),
        simulation("feed-forward without end", "--feed-forward 1e8", "up to 10"),
        simulation("a joint held far away", "--lock 1=1e9", "--lock 1"),
        simulation("gains that no step bears", "--kp 1e9 --kd 1e6", "diverged"),
    ]


def running() -> list[Case]:
    return [
        Case("harmonics without end", "excite 3r -o m.csv --harmonics 500", "1 to 40"),
        Case("waves without end", "excite 3r -o m.csv --base-frequency 1000", "lower base frequency"),
        Case("negative clearance", "excite 3r -o m.csv --clearance -1", "0 or more"),
        Case("simulation without a file", "simulate 3r", "-o FILE"),
        Case("simulation into a strange format", "simulate 3r -o out.mat", ".parquet"),
        Case("simulation into a folder", "simulate 3r -o x.csv/out.csv", "x.csv", {"x.csv": "mine"}),
        Case("simulation of nothing", "simulate", "SIMULATION"),
        Case("simulation of an unknown robot", "simulate pandda -o out.csv", "panda"),
        Case("simulation of a missing model", "simulate gone.json -o out.csv", "gone.json"),
        Case("a model and joints", "simulate m.json --joints 1 -o out.csv", "m.json", {"m.json": "{}"}),
        simulation("duration zero", "--duration 0", "at least one step"),
        simulation("duration infinite", "--duration inf", "at least one step"),
        simulation("duration below a step", "--duration 1e-5", "at least one step"),
        simulation("step zero", "--step 0", "positive"),
        simulation("rate between steps", "--rate 300", "333.333"),
        simulation("unknown integrator", "--integrator euler", "rk4"),
        simulation("sub-steps below zero", "--substeps -1", "--substeps"),
        simulation("noise below zero", "--noise -1", "noise"),
        simulation("noise that hides all torque", "--noise 1e9", "0 to 10"),
        simulation("coloured noise that hides all torque", "--coloured-noise 11", "0 to 10"),
        simulation("jitter without end", "--jitter 1e6", "0 to 10"),
        simulation("every row lost", "--drop-outs 1", "drop-outs"),
        simulation("encoder without bits", "--encoder-bits 0", "bits"),
        simulation("every joint held", "--lock 1=0 --lock 2=0 --lock 3=0", "every joint"),
    ]


def exciting() -> list[Case]:
    def excited(name: str, given: str, says: str, robot: str = "3r") -> Case:
        return Case(f"excited: {name}", f"excite {robot} -o out.csv {given}", says)

    return [
        Case("excited: no file", "excite 3r", "-o FILE"),
        Case("excited: into a recording's column", "excite 3r -o out.xls", ".csv"),
        excited("unknown kind", "--kind magic", "magic"),
        excited("unknown criterion", "--criterion magic", "magic"),
        excited("duration zero", "--duration 0", "positive"),
        excited("no harmonics", "--harmonics 0", "harmonic"),
        excited("less than a period", "--duration 5 --base-frequency 0.1", "period"),
        excited("no velocity", "--velocity-scale 0", "--velocity-scale"),
        excited("nearly no velocity", "--velocity-scale 1e-12", "0.001 to 10"),
        excited("torque without end", "--torque-scale 1e9", "0.001 to 10"),
        excited("unknown effect", "--effects magic", "magic"),
        excited("effect that is not linear", "--effects stribeck_friction", "stribeck_friction"),
        excited("one law", "--separate spring@2", "two laws"),
        excited("three laws", "--separate spring@2,spring@1,spring@3", "two laws"),
        excited("the same law", "--separate spring@2,spring@2", "same"),
        excited("strange law", "--separate spring@2,magic", "magic"),
        excited("strange number", "--separate spring@2:colour=1,payload", "colour"),
        Case("effects: a strange one", "effects magic", "magic"),
    ]


CASES = [*injections(), *driving(), *running(), *exciting()]
