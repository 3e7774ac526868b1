"""Run a demonstration: conceal laws, record, diagnose, and compare the findings with what was concealed, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ..diagnose import Diagnosis, Finding, diagnose
from ..effects import EFFECTS
from ..effects.naming import law_name, law_place
from ..errors import readable
from ..model import Model, stated_inertials, stated_laws
from ..output.replay import Replay, replay
from ..output.report import figure, with_interval
from ..output.report.documents import fit_with_errors, provenance
from ..output.report.layout import confidence, heading, new_table
from ..output.report.quantities import law_numbers
from ..recording import read_recording
from ..recording.formats import find_format
from ..regression.motion import Motion
from ..regression.session import Options
from ..robot import hold, resting
from ..robot.dynamics import joint_of_row, own_row
from ..simulation.excite import build_limits, excite
from ..simulation.plant import Sensors, record, simulate, track
from ..types import Array, Frozen, Indices, Input, Law, Progress, Robot, Trajectory

RECORDINGS = ("recording.csv", "held_out.csv")  # training data, held-out data
PERIOD, PERIODS, HARMONICS = 8.0, 2, 8  # period of a motion [s], number of periods, harmonics
SECONDS = PERIODS * PERIOD  # length of a recording [s]
HERTZ, BITS, NOISE_SHARE = 250.0, 17, 0.01  # sampling rate [Hz], encoder bits, torque noise over rms torque
USED_LIMIT_SHARE = 0.7  # share of every limit that the motions use
SIZING_DECIMATION = 10  # decimation of the motion that determines the size of the laws
FOUND_LAW, MINOR_LAW, RIVAL_LAW, MISSED_LAW = "found", "minor", "alternative", "missed"
OUTCOME_WORDS = {
    FOUND_LAW: ("found", "green"),
    MINOR_LAW: ("found, as a correction", "green"),
    RIVAL_LAW: ("only an alternative", "yellow"),
    MISSED_LAW: ("missed", "bold red"),
}
EFFECT_SETS = (  # combinations of effects, chosen by the seed
    ("spring", "viscous_friction", "coulomb_friction"),
    ("base_tilt", "spring", "coulomb_friction"),
    ("payload", "coulomb_friction"),
    ("armature", "viscous_friction"),
    ("payload", "spring"),
    ("viscous_friction", "spring"),
    ("base_tilt", "viscous_friction"),
    ("payload", "viscous_friction", "coulomb_friction"),
    ("spring", "armature"),
    ("base_tilt", "coulomb_friction"),
)
LAW_TORQUE_RANGE, PAYLOAD_TORQUE_RANGE = (0.15, 0.3), (0.4, 0.8)  # range of torque over the std of the joint's
MIN_TORQUE_SHARE = 0.02  # joints with less than this share of the largest joint torque get no law
MIN_BODY_LAW_JOINTS = 3  # minimum number of joints for laws of bodies to be distinguishable
UNIT_TILT, MAX_TILT = 0.05, 0.1  # tilt at which the size is evaluated, and largest tilt [rad]
MAX_REST_OFFSET = 0.3  # largest offset of a spring's rest position from the mean position [rad or m]
CONCEALED_DIGITS = 2  # significant digits of the concealed parameters


class LawOutcome(NamedTuple):
    """Result for a concealed law."""

    law: Law
    kind: str  # found (as a cause), minor (a correction), alternative (to another law), or missed
    finding: Finding | None  # the matching finding, or the one with the matching alternative
    probability: float  # probability of the law

    @property
    def found(self) -> Finding | None:
        """The finding of the law itself, if there is one."""
        return self.finding if self.kind in (FOUND_LAW, MINOR_LAW) else None


@dataclass(frozen=True, eq=False)
class Story(Frozen):
    """A demonstration: concealed laws and the diagnosis of the recordings."""

    simulation: Model  # the diagnosed description
    concealed: tuple[Law, ...]
    files: Mapping[str, bytes]  # recordings by file name: training, held out
    result: Diagnosis
    replay: Replay
    seed: int

    @property
    def outcomes(self) -> tuple[LawOutcome, ...]:
        """Result for each concealed law."""
        return tuple(_outcome(law, self.result) for law in self.concealed)

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of the diagnosis, and wrong findings."""
        misses: list[str] = []
        for law, kind, finding, probability in self.outcomes:
            concealed = f"{law_name(law, self.result.robot)} was concealed"
            if kind == MISSED_LAW:
                misses.append(f"{concealed} and missed")
            if kind == RIVAL_LAW and finding is not None:
                beside = law_name(finding.law, self.result.robot)
                misses.append(
                    f"{concealed} and named only as an alternative to {beside}, with probability {probability:.3f}"
                )
        for cause in self.result.causes:
            if not any(cause is outcome.finding for outcome in self.outcomes):
                misses.append(f"{law_name(cause.law, self.result.robot)} was named but not concealed")
        return (*self.result.flags, *misses)


def demo(robot: Robot, folder: str | Path, *, seed: int = 0, progress: Progress | None = None) -> Story:
    """Record a robot with concealed laws, and diagnose its simulation.

    The longest limb moves, the other joints are held. The diagnosis uses only the description and the files of the
    recordings, which are named as if they lay in the folder. Nothing is written there.
    """
    report = progress or (lambda stage, share: None)
    report("planning motions", 0.0)
    arm = take_arm(robot)
    known = Model(arm, stated_inertials(arm), stated_laws(arm))
    motions = [_motion(known, 2 * seed + k) for k in range(len(RECORDINGS))]
    report("recording", 0.2)
    coarse = Motion(arm, *(getattr(motions[0], key)[::SIZING_DECIMATION] for key in "tqva"))
    concealed = conceal(known, coarse, seed)
    true = replace(known, laws=(*known.laws, *concealed))
    files = {}
    for k, (name, motion) in enumerate(zip(RECORDINGS, motions, strict=True)):  # the controller knows the description
        moved = simulate(true, track(known, motion), SECONDS)
        columns = record(true.robot, moved, Sensors(HERTZ, BITS, NOISE_SHARE), seed=2 * seed + k)
        files[name] = find_format(Path(name)).encode(columns, name)
    read = []
    with TemporaryDirectory() as place:
        for name, content in files.items():
            path = Path(place, name)
            path.write_bytes(content)
            read.append(replace(read_recording(path, arm), path=readable(str(Path(folder, name)))))
    train, held_out = read
    result = diagnose(
        known,
        [train],
        held_out=[held_out],
        options=Options(seed=seed),
        progress=lambda stage, share: report(stage, 0.3 + 0.6 * share),
    )
    report("drawing", 0.9)
    return Story(known, concealed, files, result, replay(known, held_out, result), seed)


def _motion(known: Model, seed: int) -> Trajectory:
    """A repeated random motion; repetition separates noise from physics."""
    limits = build_limits(known.robot, margin=USED_LIMIT_SHARE, torque=np.inf)
    drawn = excite(
        known, kind="random", duration=PERIOD, harmonics=HARMONICS, limits=limits, rate=HERTZ, seed=seed
    ).trajectory
    q, v, a = (np.vstack([x[:-1]] * (PERIODS - 1) + [x]) for x in (drawn.q, drawn.v, drawn.a))
    return Trajectory(known.robot.joints, np.arange(len(q)) / HERTZ, q, v, a)


def take_arm(robot: Robot) -> Robot:
    """Return the robot with all joints held except those of its longest limb without fingers.

    Fingers are the part of the limb after its last branching, if that is the shorter part.
    """
    at = {joint_of_row(robot.model, own_row(robot, j)): joint for j, joint in enumerate(robot.joints)}
    limb = max(([k for k in robot.model.supports[i] if k in at] for i in at), key=len)
    forks = [k for k, i in enumerate(limb, 1) if len(robot.model.children[i]) > 1]
    if forks and 2 * forks[-1] > len(limb):
        limb = limb[: forks[-1]]
    return hold(robot, resting(robot, but=[at[i] for i in limb]))


def _outcome(law: Law, result: Diagnosis) -> LawOutcome:
    """The finding of the law, else the first one with the law as an alternative."""
    named_laws = [(FOUND_LAW if x.role == "cause" else MINOR_LAW, x, x.law, x.probability) for x in result.findings]
    named_laws += [(RIVAL_LAW, x, rival.law, rival.probability) for x in result.findings for rival in x.alternatives]
    for kind, finding, named, probability in named_laws:
        if (named.effect.name, named.joints) == (law.effect.name, law.joints):
            return LawOutcome(law, kind, finding, probability)
    return LawOutcome(law, MISSED_LAW, None, 0.0)


def conceal(known: Model, motion: Motion, seed: int) -> tuple[Law, ...]:
    """Draw laws at random joints with random parameters, each with a relevant torque along a motion.

    Laws that the simulation already states at the same joint are not drawn.
    """
    torque, rng = known.inverse(motion), np.random.default_rng(seed)
    scale, kind = np.std(torque, axis=0), known.robot.prismatic
    largest = np.array([np.max(scale[kind == slides]) for slides in kind])  # of the joints of the same kind
    strong = np.flatnonzero(scale >= MIN_TORQUE_SHARE * largest)
    possible = [names for names in EFFECT_SETS if all(_law_joints(known, strong, name) for name in names)]
    laws: list[Law] = []
    for name in possible[seed % len(possible)]:
        taken, places, effect = [law.joints for law in laws], _law_joints(known, strong, name), EFFECTS[name]
        joints = tuple(rng.choice([place for place in places if place not in taken] or places).tolist())
        unscaled = _unscaled(known, motion, name, joints, rng)
        unit = Law(effect, joints, unscaled)
        added = Model(known.robot, known.inertials, (*known.laws, unit)).inverse(motion) - torque
        size = np.max(np.std(added[:, strong], axis=0) / scale[strong])  # at the joint most affected
        factor = rng.uniform(*PAYLOAD_TORQUE_RANGE if name == "payload" else LAW_TORQUE_RANGE) / size
        factor = min(factor, MAX_TILT / UNIT_TILT) if name == "base_tilt" else factor
        numbers = {key: x if key == "rest" else factor * x for key, x in unscaled.items()}
        laws.append(Law(effect, joints, {key: float(f"{x:.{CONCEALED_DIGITS}g}") for key, x in numbers.items()}))
    return tuple(laws)


def _law_joints(model: Model, strong: Indices, name: str) -> list[tuple[int, ...]]:
    """Joints where a law is possible and not yet stated by the simulation."""
    effect, n = EFFECTS[name], len(model.robot.joints)
    if effect.scope in ("robot", "tip"):
        return [tuple(range(n)) if effect.scope == "robot" else (n - 1,)] if n >= MIN_BODY_LAW_JOINTS else []
    known = [law.joints for law in model.laws if law.effect.name == name and any(law.parameters.values())]
    first = int(name == "armature")  # at the first joint it is equivalent to link inertia
    return [(j,) for j in strong.tolist() if (j,) not in known and j >= first]


def _unscaled(
    model: Model, motion: Motion, name: str, joints: tuple[int, ...], rng: np.random.Generator
) -> Mapping[str, float]:
    """Parameters of a law, before scaling."""
    if name == "payload":
        robot, body = model.robot, joint_of_row(model.robot.model, own_row(model.robot, joints[0]))
        ends: list[Array] = [frame.placement.translation for frame in robot.model.frames if frame.parentJoint == body]
        furthest = ends[int(np.argmax(np.linalg.norm(ends, axis=1)))]
        centre = zip("xyz", furthest, strict=True)
        return {"mass": 1.0, **{f"first_moment_{axis}": float(x) for axis, x in centre}}
    if name == "base_tilt":
        way = rng.uniform(0, 2 * np.pi)
        return {"x": UNIT_TILT * np.cos(way), "y": UNIT_TILT * np.sin(way)}
    if name == "spring":
        middle = float(np.mean(motion.q[:, joints[0]]))
        return {"stiffness": 1.0, "rest": middle + rng.uniform(-MAX_REST_OFFSET, MAX_REST_OFFSET)}
    return dict.fromkeys(EFFECTS[name].parameters, 1.0)


def comparison(story: Story) -> list[RenderableType]:
    """Table of the concealed laws: true and found parameters, and probabilities."""
    robot, table = story.simulation.robot, new_table("concealed", "true>", "found>", "±>", "unit", "probability>", "")
    for outcome in story.outcomes:
        shown = confidence(outcome.probability) if outcome.probability else "-"
        table.add_row(law_name(outcome.law, robot), "", "", "", "", shown, Text(*OUTCOME_WORDS[outcome.kind]))
        for key, number in _numbers(story, outcome).items():
            value, std = number["found"], number["std"]
            cells = ("-" if value is None else figure(value), "-") if std is None else with_interval(value, std)
            table.add_row(f"  {key}", figure(number["value"]), *cells, number["unit"], "", "")
    return [heading("Concealed and found laws, ± 95 %"), table]


def _numbers(story: Story, outcome: LawOutcome) -> dict[str, dict[str, Any]]:
    """True value, unit, and estimate with standard deviation of each parameter; None: not found."""
    robot, named = story.simulation.robot, outcome.found
    estimates = {x.name: (x.value, x.std) for x in law_numbers(robot, named.law, named.std)} if named else {}
    numbers = {}
    for true in law_numbers(robot, outcome.law, {}):
        value, std = estimates.get(true.name, (None, None))
        numbers[true.name] = {"value": true.value, "unit": true.unit, "found": value, "std": std}
    return numbers


def story_document(story: Story, name: str) -> dict[str, Any]:
    """Build demo.json: concealed laws, findings and validation; `name` is the robot as given on the command line."""
    result, robot = story.result, story.simulation.robot
    before, after = result.rollout_before, result.rollout_after
    concealed: list[dict[str, Any]] = []
    for outcome in story.outcomes:
        arm, (law, kind, finding, probability) = story.simulation.robot, outcome
        concealed.append(
            {
                "effect": law.effect.name,
                "joint": law_place(law, arm)[0],
                "outcome": kind,
                "probability": probability,
                "alternative_to": law_name(finding.law, arm) if finding and not outcome.found else None,
                "parameters": _numbers(story, outcome),
            }
        )
    return {
        "schema": "signid.demo/1",
        "robot": robot.name,
        "joints": list(robot.joints),
        "recordings": {"duration": SECONDS, "rate": HERTZ, "encoder_bits": BITS, "torque_noise": NOISE_SHARE},
        "verdict": result.verdict,
        "concealed": concealed,
        "fit": {"before": fit_with_errors(result.before), "after": fit_with_errors(result.after)},
        "rollout": None if before is None or after is None else after.document(before),
        "flags": list(story.flags),
        "notes": list(result.notes),
        **provenance(result.inputs, [Input(readable(name), robot.sha256, "description")], story.seed),
    }
