"""Recordings that are simulated, converted or downloaded, and motions to record: JSON documents and terminal tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
from rich.console import RenderableType

from ....errors import shorten
from ....recording.gallery import DataSet, is_complete
from ....recording.mapping import split
from ....servos import servos_document
from ....types import Array, Input, Law, Robot
from ....version import __version__
from ..documents import Document, description, ending, opening, picked, provenance
from ..layout import figure, heading, new_table, note_lines, paragraph, plural, position_units, share, torque_units
from ..quantities import law_document
from ..sections import Cells, Plain, Section, Sentences, terminal

if TYPE_CHECKING:
    from ....model import Model
    from ....recording.convert import Conversion
    from ....servo.simulate import ServoSimulation
    from ....simulation.excite import Excitation, Separation
    from ....simulation.plant import Sensors, Simulation
    from ....simulation.plant.control import Drive

MAX_TOPIC_JOINTS = 4  # number of joints listed per topic
NOTED_TRACKING_ERRORS = 0.005, 0.05  # rms tracking error from which a joint is noted, prismatic [m] and revolute [rad]
LIMIT_NAMES = "position velocity acceleration torque"
MAX_WEAKEST_PARAMETERS = 8  # number of least identifiable base parameters listed
UNIDENTIFIABLE_DEVIATION = 1.0  # relative standard deviation from which a parameter is not distinguishable from zero


def conversion_document(conversion: Conversion, inputs: Sequence[Input] = ()) -> Document:
    """Build the output of `signid convert --json`; `inputs` are files read besides the source."""
    pace, clock = conversion.pace, conversion.about.clock or None
    return {
        "schema": "signid.conversion/1",
        "rows": _rows(conversion),
        "columns": list(conversion.columns),
        "joints": [{"name": joint, "columns": kinds} for joint, kinds in conversion.joints.items()],
        "units": dict(conversion.units),
        "time": pace and {**picked(pace, "duration rate gaps"), "longest_gap": pace.longest, "clock": clock},
        "topics": [
            {"name": topic.name, "type": topic.kind, **picked(topic, "messages rate joints read")}
            for topic in conversion.about.topics
        ],
        "joined": [picked(file, "path offset estimate std") for file in conversion.joined],
        **ending(conversion, _sources(conversion), inputs, 0),
    }


def conversion_tables(conversion: Conversion) -> list[RenderableType]:
    """Topics, joints and timing of a conversion."""
    topics = new_table("topic", "type", "messages>", "Hz>", "joints")
    for topic in conversion.about.topics:
        rate = figure(topic.rate) if np.isfinite(topic.rate) else ""
        names = shorten(topic.joints, MAX_TOPIC_JOINTS) if topic.read else "(not read)"
        topics.add_row(topic.name, topic.kind.rpartition("/")[2], str(topic.messages), rate, names)
    joints = new_table("joint", "columns", *(["converted from"] if conversion.units else []))
    for joint, kinds in conversion.joints.items():
        units = dict.fromkeys(unit for kind in kinds if (unit := conversion.units.get(f"{kind}_{joint}")))
        joints.add_row(joint, " ".join(kinds), *([", ".join(units)] if conversion.units else []))
    others = [name for name in conversion.columns if name != "t" and not split(name)]
    title = f"{' + '.join(source.path for source in _sources(conversion))}: {plural(_rows(conversion), 'row')}"
    if (pace := conversion.pace) is not None:
        gaps = f"{plural(pace.gaps, 'gap')} of up to {figure(pace.longest)} s" if pace.gaps else "no gap"
        title += f", {figure(pace.duration)} s at {figure(pace.rate)} Hz, {gaps}"
    return [
        heading(title, below=False),
        *([topics] if conversion.about.topics else []),
        *([joints] if conversion.joints else []),
        *([paragraph(f"Other columns, unchanged: {shorten(others)}")] if others else []),
        *([paragraph(f"Clock: {conversion.about.clock}.")] if conversion.about.clock else []),
        *note_lines(conversion.notes),
    ]


def _sources(conversion: Conversion) -> list[Input]:
    return [conversion.source, *(Input(file.path, file.sha256, conversion.source.role) for file in conversion.joined)]


def _rows(conversion: Conversion) -> int:
    return len(next(iter(conversion.columns.values()), ()))


def data_document(sets: Iterable[DataSet], folder: Path, written: Sequence[Path] = ()) -> Document:
    """Build the output of `signid data --json`: data sets and written files."""
    described = [
        {
            "name": data.name,
            "title": data.title,
            "duration": data.seconds,
            **picked(data, "drives repository commit base licence cite megabytes"),
            "folder": str(folder / data.folder),
            "here": is_complete(data, folder / data.folder),
            "files": [{"name": x.name, "sha256": x.sha256, "sources": list(x.sources)} for x in data.products],
        }
        for data in sets
    ]
    known = {"schema": "signid.data/1", "folder": str(folder), "sets": described}
    return {**known, "written": [str(path) for path in written], "version": __version__}


def data_tables(sets: Iterable[DataSet], folder: Path) -> list[RenderableType]:
    """List the data sets by what they hold, and whether they are present."""
    listed, parts = list(sets), list[RenderableType]()
    for title, drives in (("Torques or motor currents", False), ("Position drives: commands and positions", True)):
        table = new_table("name", "content", "duration [s]>", "download [MB]>", "present")
        for data in (data for data in listed if data.drives is drives):
            here = "yes" if is_complete(data, folder / data.folder) else "no"
            table.add_row(data.name, data.title, f"{data.seconds:.0f}", f"{data.megabytes:g}", here)
        parts += [heading(title, below=bool(parts)), table] if table.rows else []
    sources = [paragraph(f"{data.name}: github.com/{data.repository}, licence {data.licence}") for data in listed]
    advice = f"\nsignid data NAME downloads one into {folder} after confirmation."
    return [*parts, paragraph(""), *sources, paragraph(advice)]


def data_card(wanted: DataSet, folder: Path, base: str) -> list[RenderableType]:
    """Source, licence and size of a data set."""
    rows = {
        "source": f"https://github.com/{wanted.repository}",
        "commit": wanted.commit,
        "from": urlsplit(base).netloc if base == wanted.base else base,
        "licence": wanted.licence,
        "cite": wanted.cite,
        "download": f"{plural(len(wanted.sources), 'file')}, about {wanted.megabytes:g} MB",
        "into": str(folder / wanted.folder),
    }
    table = new_table("", "", rows=rows.items())
    table.show_header = False
    return [paragraph(f"{wanted.name}: {wanted.title}, {wanted.seconds:.0f} s"), table]


@dataclass(frozen=True)
class SimulationRun:
    """A simulation with its model, drive and recording."""

    model: Model  # including the injected laws
    injected: tuple[Law, ...]
    simulation: Simulation
    columns: Mapping[str, Array]  # (N,) each, as recorded [units of their names]
    sensors: Sensors
    drive: Drive  # drive of the robot
    integrator: str
    without_drives: tuple[str, ...] = ()  # joints whose position drives take no part, except by friction and armature

    @property
    def acting(self) -> list[Law]:
        """Laws with nonzero coefficients."""
        return [law for law in self.model.laws if any(law.effect.coefficients(law.parameters))]

    @property
    def notes(self) -> tuple[str, ...]:
        """Defaults used for missing data of the description, and violated limits."""
        robot, s = self.model.robot, self.simulation
        error = np.zeros(len(robot.joints)) if self.tracking_rms is None else self.tracking_rms
        said: dict[str, Any] = {
            "exceeded its position limits": ((s.true_q < robot.lower) | (s.true_q > robot.upper)).any(axis=0),
            "exceeded its torque limit": (np.abs(s.applied) > robot.effort_limit).any(axis=0),
            "tracked poorly; a larger --bandwidth may help": error > np.where(robot.prismatic, *NOTED_TRACKING_ERRORS),
        }
        named = {text: list(compress(robot.joints, which)) for text, which in said.items()}
        drives = [
            f"torque moves the robot: of the position drives of {shorten(self.without_drives)} only armature, friction "
            f"and offset act; --servo simulates the drives"
        ] * bool(self.without_drives)
        sentences = (f"{shorten(joints)} {text}" for text, joints in named.items() if joints)
        return (*robot.notes, *drives, *sentences)

    @property
    def torque_rms(self) -> Array:
        """Rms of the recorded torque, (n,) [N.m or N]."""
        return np.sqrt([np.mean(x**2) for name, x in self.columns.items() if name.startswith(("tau_", "abs_tau_"))])

    @property
    def tracking_rms(self) -> Array | None:
        """Rms of desired - true position, (n,) [rad or m]; None without desired positions."""
        if not any(name.startswith("q_des_") for name in self.columns):
            return None
        return np.asarray(np.sqrt(np.mean((self.simulation.desired - self.simulation.true_q) ** 2, axis=0)))


def simulation_document(run: SimulationRun, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid simulate --json`; `inputs` defaults to the robot description."""
    from ....simulation.plant.control import Tracking

    robot, s, drive = run.model.robot, run.simulation, {"kind": "open loop"}
    if isinstance(run.drive, Tracking):
        drive = {"kind": "closed loop", **picked(run.drive, "stiffness damping feed_forward")}
    return {
        **opening("signid.simulation/1", robot),
        "effects": [
            {**law_document(robot, law), "injected": any(law is other for other in run.injected)}
            for law in run.model.laws
        ],
        "drive": drive,
        "step": float(s.t[1] - s.t[0]) if len(s.t) > 1 else None,
        "duration": float(s.t[-1]),
        "integrator": run.integrator,
        "sensors": asdict(run.sensors),
        "rows": len(run.columns["t"]),
        "columns": list(run.columns),
        "torque_rms": run.torque_rms,
        "torque_unit": torque_units(robot),
        "tracking_rms": run.tracking_rms,
        "position_unit": position_units(robot),
        "notes": list(run.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def simulation_tables(run: SimulationRun) -> list[RenderableType]:
    """Acting laws, and recorded torque and tracking error of each joint."""
    robot, laws = run.model.robot, []
    for law in run.acting:
        entry = law_document(robot, law)
        injected = "injected" if any(law is other for other in run.injected) else ""
        first = (entry["effect"], entry["joint"] or "(robot)")
        for key, p in entry["parameters"].items() or [("", {"value": "", "unit": ""})]:
            value = f"{p['value']:g}" if isinstance(p["value"], float) else p["value"]
            laws.append((*first, key, value, p["unit"], injected))
            first, injected = ("", ""), ""
    errors = [np.nan] * len(robot.joints) if run.tracking_rms is None else run.tracking_rms
    columns = (robot.joints, run.torque_rms, torque_units(robot), errors, position_units(robot))
    joints = [(joint, figure(x), unit, figure(e), length) for joint, x, unit, e, length in zip(*columns, strict=True)]
    sections = [
        Section("", (Cells(("joint", "rms torque>", "unit", "rms tracking error>", "unit"), joints),)),
        Section("Laws", (Cells(("law", "joint", "parameter", "value>", "unit", ""), laws),)),
        Section("", (Plain("" if laws else "No law acts in addition to the rigid bodies."),)),
    ]
    rows = plural(len(run.columns["t"]), "row")
    title = heading(f"{robot.name}: {rows}, {figure(float(run.simulation.t[-1]))} s", below=False)
    return [title, *terminal(sections, run.notes)]


def servo_simulation_document(run: ServoSimulation, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid simulate --servo --json`; `inputs` defaults to the robot description."""
    robot = run.model.robot
    return {
        **opening("signid.servo_simulation/1", robot),
        "joints": list(robot.joints),
        "servos": servos_document(run.model.servos, robot.joints),
        "injected": list(run.injected),
        "duration": float(run.t[-1]),
        "step": float(run.t[1] - run.t[0]),
        "sensors": asdict(run.sensors),
        "rows": len(run.columns["t"]),
        "columns": list(run.columns),
        "error_rms": run.error_rms,
        "position_unit": position_units(robot),
        "saturated_share": run.saturated,
        "notes": list(run.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def servo_simulation_tables(run: ServoSimulation) -> list[RenderableType]:
    """Drive, error of following and share of saturation of each joint."""
    robot, servos, joints = run.model.robot, run.model.servos, []
    columns = (robot.joints, run.error_rms, position_units(robot), run.saturated)
    for joint, error, unit, full in zip(*columns, strict=True):
        if (servo := servos.get(joint)) is not None:
            numbers = (figure(servo.kp), figure(1e3 * servo.lag), figure(float(error)), unit, share(float(full)))
            joints.append((joint, servo.law, *numbers))
    heads = ("joint", "law", "kp>", "lag [ms]>", "rms of q_des - q>", "unit", "saturated>")
    section = Section("", (Cells(heads, joints), Sentences([f"injected: {text}" for text in run.injected])))
    rows = plural(len(run.columns["t"]), "row")
    title = f"{robot.name}: {rows}, {figure(float(run.t[-1]))} s, closed loop from commands"
    return [heading(title, below=False), *terminal([section], run.notes)]


def excitation_document(
    excitation: Excitation | Separation, inputs: Sequence[Input] = (), *, robot: Robot, seed: int = 0
) -> Document:
    """Build the output of `signid excite --json`; `inputs` defaults to the robot description."""
    from ....simulation.excite import Separation

    if isinstance(excitation, Separation):
        laws = [law_document(robot, law) for law in excitation.laws]
        values = picked(excitation, "distances shares median structural enough")
        purpose = {"purpose": "separate", "laws": laws, **values}
    else:
        rows = zip(excitation.expressions, excitation.std, excitation.relative_std, strict=True)
        purpose = {
            "purpose": "excite",
            **picked(excitation, "kind criterion value log_det condition"),
            "base_parameters": [{"expression": e, "std": s, "relative_std": r} for e, s, r in rows],
            "evaluations": excitation.evaluations,
        }
    return {
        **opening("signid.excitation/1", robot),
        "duration": float(excitation.trajectory.t[-1]),
        "rows": len(excitation.trajectory.t),
        **purpose,
        "noise": excitation.noise,
        "torque_unit": torque_units(robot),
        "use": picked(excitation.use, LIMIT_NAMES),
        "smallest_distance": excitation.distance,
        **ending(excitation, (), inputs or [description(robot)], seed),
    }


def excitation_tables(found: Excitation | Separation, *, robot: Robot) -> list[RenderableType]:
    """Use of the limits, and identifiability or distance of laws along the motion."""
    from ....simulation.excite import Separation

    used = zip(robot.joints, *picked(found.use, LIMIT_NAMES).values(), strict=True)
    limits = [(joint, *(share(float(x)) for x in parts)) for joint, *parts in used]
    near = "" if found.distance is None else f"Smallest distance between links: {figure(1e3 * found.distance)} mm."
    gained = _discrimination(robot, found) if isinstance(found, Separation) else _identifiability(found)
    heads = ("share of limit", *(f"{name}>" for name in LIMIT_NAMES.split()))
    size = f"{plural(len(found.trajectory.t), 'row')}, {figure(float(found.trajectory.t[-1]))} s"
    sections = [Section("", (Cells(heads, limits), Plain(near))), *gained]
    return [heading(f"{robot.name}: {size}", below=False), *terminal(sections, found.notes)]


def _identifiability(found: Excitation) -> list[Section]:
    order = [k for k in np.argsort(-np.nan_to_num(found.relative_std, nan=0.0)) if np.isfinite(found.relative_std[k])]
    rows = [(found.expressions[k], share(float(found.relative_std[k]))) for k in order[:MAX_WEAKEST_PARAMETERS]]
    weak = int(np.sum(found.relative_std[order] >= UNIDENTIFIABLE_DEVIATION))
    condition = f"Condition number of the regressor {figure(found.condition)}"
    tried = f"log det of the information {found.log_det:.1f}; {plural(found.evaluations, 'motion')} tried"
    hardly = f"{weak} of them will hardly be distinguishable from zero." if weak else ""
    title = f"Least identifiable of {plural(len(found.std), 'base parameter')}"
    return [
        Section("", (Plain(f"{condition}, {tried}."),)),
        Section(title, (Cells(("base parameter", "std over value>"), rows), Plain(hardly))),
    ]


def _discrimination(robot: Robot, separation: Separation) -> list[Section]:
    rows = []
    for law, distance, part in zip(separation.laws, separation.distances, separation.shares, strict=True):
        entry = law_document(robot, law)
        rows.append((entry["effect"], entry["joint"] or "(robot)", figure(distance), share(part)))
    if separation.structural:
        verdict = "No motion can discriminate these laws."
    elif separation.enough:
        verdict = f"The motion discriminates the laws; a random motion reaches {figure(separation.median)} (median)."
    else:
        verdict = "The laws may remain indistinguishable."
    heads = ("true law", "joint", "distance of the other>", "share of its torque unexplained>")
    title = "Distance of the laws: squared difference of torque over noise"
    return [Section(title, (Cells(heads, rows), Plain(verdict)))]
