"""Identification of position drives: JSON document, terminal tables and page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ....effects import EFFECTS
from ....model import standard_parameters
from ....servos import PASSIVE_LAWS
from ....types import Array, Input, pseudo_inertia
from ..documents import Document, description, ending, opening, picked, stamps_clock
from ..layout import Worse, plural, share, thousandths
from ..pages import FRICTION_LEGEND, Header, friction_plots, sections_page, shared
from ..plots import loop_blocks, worst_joints
from ..quantities import Quantity, effect_document, grid, spaced
from ..sections import Block, Card, Cells, Legend, Plain, Plots, Section, Sentences, terminal
from .sentences import WORSE_ERROR_RATIO

if TYPE_CHECKING:
    from ....servo.identify import FrictionModel, ServoIdentification, ServoJoint, ServoNumber, ServoRollOut

LEADING = ("kp", "damping", "delay", "lag", "effort_limit", "armature", "coulomb_friction", "load_friction")
EFFECT_NUMBERS = (*PASSIVE_LAWS, "load_friction")  # numbers of a drive that are written as effects
MAX_ROUNDED = 1e-9  # eigenvalue over trace of a pseudo-inertia that counts as 0, as of a link without mass
DRIVE_NUMBERS_LEGEND = (
    "damping: kd of the drive, viscous friction and back-EMF together; lag: delay + damping / kp; saturated: share of "
    "samples in which the drive gives its limit."
)
LOOP_HEADS = ("predicted", "of tracking", "every second")  # heads of `loop_cells`
BOUND_LEGEND = "< and > are bounds of numbers that are not identifiable; - is one without a bound."
IDEAL_LOOP = "q = q_des"  # the nominal loop where no gain is stated
DAMPING = "kd + viscous_friction + back_emf"
FRICTION_MODELS_LEGEND = (
    "Each model takes the place of the friction of the drives and is fitted to the same windows of the training rows. "
    "The log Bayes factor is that of these rows over the first model; the probability allows for their differences. "
    "M1 to M6: Duclusaud et al., arXiv 2410.08650; PACE: Bjelonic et al., 2025."
)


def servo_identification_document(result: ServoIdentification, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of identification.json; `inputs` besides the recordings default to the robot description."""
    robot, model = result.robot, result.model
    inertials, scale = np.asarray(model.inertials), result.scale
    models = [_model(x, result.rollout.held_out) for x in result.friction_models]
    bodies = list(map(pseudo_inertia, inertials))
    zeros = [
        {
            **picked(zero, "joint sign sign_probability"),
            "zero": {"value": zero.zero, "std": zero.std, "unit": "rad"},
            "identifiable": zero.identifiable,
        }
        for zero in result.zeros
    ]
    effects = []
    for drive in result.joints:
        numbers = {x.name: x for x in drive_numbers(drive) if x.known}
        for x in (numbers[name] for name in EFFECT_NUMBERS if name in numbers):
            key = next(iter(EFFECTS[x.name].parameters))
            effects.append(effect_document(x.name, drive.joint, [Quantity(key, x.value, x.std, x.unit)]))
    return {
        **opening("signid.identification/1", robot),
        "base_parameters": [],
        "standard_parameters": standard_parameters(model.robot, inertials),
        "physically_consistent": all(np.linalg.eigvalsh(x)[0] >= -MAX_ROUNDED * abs(np.trace(x)) for x in bodies),
        "effects": effects,
        "signs": None,
        "fit": {**position_fit(result.rollout), "refit": result.refit},
        "varies": [number._asdict() for number in result.varies],
        "method": "output error of the closed loop",
        "recordings": [
            {"path": log.path, "clock": stamps_clock(log.period), "content_rate": log.content_rate}
            for log in result.logs
        ],
        "servo": {
            "scale": {
                "set_by": scale.known_by,
                "share_of_known_load": {joint.joint: joint.known_load_share for joint in result.joints},
                "sentence": scale.sentence,
                "otherwise": "; ".join(scale.alternatives),
            },
            "joints": list(map(_joint, result.joints)),
            "rollout": {**rollout_document(result.rollout), "held_out": result.rollout.held_out},
            **({"zeros": zeros} if zeros else {}),
            **({"friction_models": models} if models else {}),
        },
        **ending(result, result.inputs, inputs or [description(robot)], result.seed),
    }


def drive_numbers(drive: ServoJoint) -> list[Quantity]:
    """Numbers of a drive, from which all outputs follow."""
    more: dict[str, Document] = {"damping": {"is": DAMPING}, "effort_limit": {"saturated_share": drive.saturated_share}}
    return [_quantity(x, drive.joint, drive.law, **more.get(x.name, {})) for x in drive.numbers.values()]


def _quantity(x: ServoNumber, joint: str, law: str = "", **more: Any) -> Quantity:
    """A number of a drive; one that is not identifiable has a sentence, and bounds if any."""
    facts = {
        "prior": x.prior and x.prior._asdict(),
        "bounds": x.bounds and list(x.bounds),
        "at_bound": x.at_bound,
        "sentence": x.sentence,
    }
    value, std = (nan, None) if x.value is None else (x.value, x.std)
    return Quantity(
        *(x.name, value, std, x.unit, joint, law),
        stated=value if x.stated else None,
        below=x.below,
        above=x.above,
        remark="bound" if x.at_bound else "stated" if x.stated else "with prior" if x.prior else "",
        more={**{key: fact for key, fact in facts.items() if fact}, **more},
    )


def _ordered(numbers: Iterable[Quantity]) -> list[Quantity]:
    """Numbers of some joints, the most asked for first."""
    return sorted(numbers, key=lambda x: LEADING.index(x.name) if x.name in LEADING else len(LEADING))


def _joint(drive: ServoJoint) -> Document:
    limit = {"value": None, "std": None, "unit": "", "saturated_share": drive.saturated_share}
    numbers = {x.name: x.document() for x in _ordered(drive_numbers(drive))}
    return {
        **picked(drive, "joint law law_probability"),
        "laws": dict(drive.laws),
        **numbers,
        "effort_limit": numbers.get("effort_limit", limit),
        "known_load_share": drive.known_load_share,
        **({"equal": list(drive.equal)} if drive.equal else {}),
        "not_identifiable": list(drive.not_identifiable),
    }


def _model(model: FrictionModel, held_out: bool) -> Document:
    by_joint = {joint: [_quantity(x, joint) for x in numbers.values()] for joint, numbers in model.numbers.items()}
    return {
        "model": model.name,
        **picked(model, "terms mean_absolute rms"),
        "held_out": held_out,
        **picked(model, "log_bayes_factor probability"),
        "processor_seconds": model.seconds,
        "joints": {joint: {x.name: x.document() for x in numbers} for joint, numbers in by_joint.items()},
    }


def position_fit(rollout: ServoRollOut) -> Document:
    """Rms position error of closed loops over whole recordings, in the form of a fit."""
    nothing = [None] * len(rollout.joints)
    return {
        "joints": list(rollout.joints),
        "unit": list(rollout.units),
        "train_rms": nothing,
        "held_out_rms": rollout.whole_rms,
        "noise_floor": nothing,
        "held_out_r2": nothing,
    }


def rollout_document(rollout: ServoRollOut) -> Document:
    """Rms position error per joint of closed loops from commands alone."""
    sizes = picked(rollout, "whole_rms one_second_rms nominal nominal_whole_rms nominal_one_second_rms tracking_rms")
    return {"joints": list(rollout.joints), **sizes, "unit": list(rollout.units)}


def servo_identification_tables(result: ServoIdentification) -> list[RenderableType]:
    """Drives with their intervals, one joint a line; what is not identifiable; errors of closed loops."""
    style = "bold red" if poor_joints(result.rollout, result.far) else "bold"
    return [Text(_headline(result), style), *terminal(_sections(result), _unsaid(result, result.notes))]


def servo_identification_page(result: ServoIdentification, inputs: Sequence[Input] = (), command: str = "") -> str:
    """Render report.html of a servo identification; `inputs` besides the recordings default to the description."""
    over = f"identification of {result.robot.name}: position drives from commands and positions, without torque"
    kind = "unreliable" if poor_joints(result.rollout, result.far) else ""
    title = f"{result.robot.name}: {plural(len(result.joints), 'position drive')}"
    cards = []
    rollout = result.rollout
    for j in worst_joints(rollout)[:1] if len(rollout.joints) > 1 else ():
        unit, tracking = rollout.units[j], float(rollout.tracking_rms[j])
        part = f"{share(float(rollout.whole_rms[j]) / tracking)} of its tracking error" if tracking > 0 else ""
        cards.append(
            Card(f"worst joint: {rollout.joints[j]}", f"{thousandths(float(rollout.whole_rms[j]))} m{unit} rms", part)
        )
    short = all_joints(rollout, rollout.one_second_rms)
    size = ", ".join(f"{thousandths(rms, 2)} m{unit}" for unit, rms in short.items())
    cards.append(Card("restarted from the measured state every second", f"{size} rms", "position error of all joints"))
    if rollout.nominal != IDEAL_LOOP:
        size = ", ".join(f"{thousandths(x, 2)} m{u}" for u, x in all_joints(rollout, rollout.nominal_whole_rms).items())
        cards.append(Card(rollout.nominal, f"{size} rms", "whole recordings"))
    cards.append(Card("scale of torque and mass", result.scale.known_by, "positions alone give ratios"))
    header = Header(title, over, cards, kind, _headline(result))
    content = shared(result, [result.robot], inputs, command)
    left = {"notes": _unsaid(result, result.notes), "flags": _unsaid(result, result.flags)}
    return sections_page(header, _sections(result, pages=True), content | left)


def _sections(result: ServoIdentification, *, pages: bool = False) -> list[Section]:
    """Sections of the terminal, or with what `pages` have beside them."""
    rollout = result.rollout
    drawn = loop_blocks(result.traces, rollout, rollout.nominal, "identified") if pages else ()
    friction = (Legend(FRICTION_LEGEND), Plots(friction_plots(result, rollout.joints))) if pages else ()
    scale = [text for text in (result.scale.sentence, *result.scale.alternatives) if text]
    if known := sorted(drive.known_load_share for drive in result.joints if isfinite(drive.known_load_share)):
        to = f"{share(known[0])} to " if len(known) > 1 else ""
        scale.append(f"the masses of the description explain {to}{share(known[-1])} of the torque of the drives")
    tried = [joint for joint in result.joints if len({*joint.laws.values()}) > 1]
    laws = list(dict.fromkeys(law for joint in tried for law in joint.laws))
    posterior = [[joint.joint, *(_probability(joint.laws.get(law)) for law in laws)] for joint in tried]
    units = loop_units(rollout)
    stated = [rollout.nominal_whole_rms] if rollout.nominal != IDEAL_LOOP else []
    rows = [
        [joint, *(thousandths(float(rms[j])) for rms in (rollout.tracking_rms, *stated)), *loop_cells(rollout, j)]
        for j, joint in enumerate(rollout.joints)
    ]
    names = ["tracking", *([rollout.nominal] if stated else []), *LOOP_HEADS]
    heads = [f"{name}\n[{units}]>" if name != LOOP_HEADS[1] else f"{name}>" for name in names]
    title = f"Closed loop from commands alone, {_rows_of(rollout)}: rms position error"
    drive_laws = dict.fromkeys(_law(drive) for drive in result.joints)
    ratios = [drive for drive in result.joints if any("/" in name for name in drive.numbers)]
    groups = [drive for drive in result.joints if drive not in ratios], ratios
    tables = [_numbers(joints, len(drive_laws) > 1) for joints in groups if joints]
    bounded = any(cell[:1] in ("<", ">", "-") for x in tables for row in x.rows for cell in row[1:] if cell[1:2] in " ")
    heading = f"Drives by the law {next(iter(drive_laws))}, ± 95 %" if len(drive_laws) == 1 else "Drives, ± 95 %"
    masses = "" if result.scale.known_by.startswith("inertials") else ", or --known masses, those of the description,"
    said = f"Torques over kp, as their scale is unknown; --known kp=VALUE, the gain at the joint{masses} sets it."
    return [
        Section(heading, (*tables, Plain(said if ratios else ""), Plain(BOUND_LEGEND if bounded else ""))).beside(
            Legend(DRIVE_NUMBERS_LEGEND)
        ),
        Section("Not identifiable", (Sentences(_unidentifiable(result)),)),
        Section("Scale of torque and mass", (Sentences(scale),)),
        Section(title, (Cells(["joint", *heads], rows),)).beside(*drawn),
        Section("Friction over speed and load", friction),
        Section("Probability of the laws that were compared", (Cells(["joint", *(f"{x}>" for x in laws)], posterior),)),
        _models(result, pages),
    ]


def _unsaid(result: ServoIdentification, lines: Iterable[str]) -> list[str]:
    """Flags or notes that are no sentence on what is not identifiable, or on the scale."""
    said = [*_unidentifiable(result), result.scale.sentence]
    return [line for line in lines if line not in said]


def _headline(result: ServoIdentification) -> str:
    """Number of drives and error of their loops; unit of torques, and how heavy bodies are with the stated gain."""
    data = " of held-out motion" if result.rollout.held_out else " of the motion of the fit"
    words = [f"{result.robot.name}: {plural(len(result.joints), 'drive')}, {loop_words(result.rollout, data)}"]
    ends = [f"{x:.2f}" for x in sorted(result.scale.mass_ratios)]
    times = " to ".join(dict.fromkeys([*ends[:1], *ends[-1:]]))
    if result.scale.known_by.startswith("inertials"):
        unit = "in units of the described masses"
        words.append(unit if times else f"{unit} (--known kp=VALUE: of the gain at the joint)")
    if times:
        words.append(f"with --known {result.scale.gain} the moved bodies are {times} times as heavy as described")
    return "; ".join(words)


def loop_words(rollout: ServoRollOut, data: str = "") -> str:
    """How well closed loops predict whole recordings: rms over all joints, and as a share of the tracking error."""
    whole = all_joints(rollout, rollout.whole_rms)
    if not all(map(isfinite, whole.values())):
        return "whose simulation diverges"
    sizes = " and ".join(f"{thousandths(rms, 2)} m{unit}" for unit, rms in whole.items())
    tracking = all_joints(rollout, rollout.tracking_rms)
    shares = " and ".join(share(rms / tracking[unit]) for unit, rms in whole.items() if tracking[unit] > 0)
    of = "their" if len(rollout.joints) > 1 else "its"
    return f"predicted to {sizes} rms{data}" + (f", {shares} of {of} tracking error" if shares else "")


def all_joints(rollout: ServoRollOut, rms: Array) -> dict[str, float]:
    """Root mean square over the joints with drives, by unit; rms: (n,) [rad or m]."""
    driven = {
        unit: [u == unit and not np.isnan(x) for u, x in zip(rollout.units, rms, strict=True)] for unit in rollout.units
    }
    return {unit: float(np.sqrt(np.mean(rms[joints] ** 2))) for unit, joints in driven.items() if any(joints)}


def poor_joints(rollout: ServoRollOut, far: Sequence[str] = ()) -> list[str]:
    """Joints whose loop is predicted badly: no better than q = q_des or the stated numbers, or `far` from training."""
    usual = np.fmin(rollout.nominal_whole_rms, rollout.tracking_rms)
    worse = dict(zip(rollout.joints, (rollout.whole_rms > WORSE_ERROR_RATIO * usual).tolist(), strict=True))
    return [joint for joint, bad in worse.items() if bad or joint in far]


def loop_cells(rollout: ServoRollOut, j: int) -> list[str]:
    """Error of a joint over whole recordings, its share of the tracking error, and the error from every second on."""
    whole, short = (thousandths(float(rms[j])) for rms in (rollout.whole_rms, rollout.one_second_rms))
    part = share(float(rollout.whole_rms[j] / rollout.tracking_rms[j])) if rollout.tracking_rms[j] > 0 else "-"
    return [Worse(whole) if rollout.joints[j] in poor_joints(rollout) else whole, part, short]


def loop_units(rollout: ServoRollOut) -> str:
    """Units of position errors in tables."""
    return " or ".join(dict.fromkeys(f"m{unit}" for unit in rollout.units))


def _numbers(joints: Sequence[ServoJoint], named: bool) -> Cells:
    """A row for each of some joints, those of ratios or the others; `named`: with their laws."""
    every = _ordered(x for drive in joints for x in drive_numbers(drive))
    names = {x.name for x in every if x.name in LEADING[:5] or (x.known and x.value)}
    if any("/" in x.name for x in every):
        names = {x.name for x in every if x.name in ("delay", "lag") or "/" in x.name}
    shown = [x.displayed() for x in every if x.name in names]
    heads, cells = grid(shown, lambda x: f"{spaced(x.name)}\n", [drive.joint for drive in joints])
    first = [[drive.joint, *([_law(drive)] if named else [])] for drive in joints]
    last = [[share(drive.saturated_share)] for drive in joints]
    limited = any(drive.saturated_share > 0 for drive in joints)
    rows = [[*a, *b, *(c if limited else [])] for a, b, c in zip(first, cells, last, strict=True)]
    return Cells(["joint", *(["law\n(probability)"] if named else []), *heads, *(["saturated>"] * limited)], rows)


def _law(drive: ServoJoint) -> str:
    if drive.law_probability is None:
        return f"{drive.law} (stated)"
    if len(drive.laws) > 1 and len({*drive.laws.values()}) == 1:
        return " or ".join(sorted(drive.laws, key=lambda law: law != drive.law))
    sure = ">0.999" if drive.law_probability > 0.999 else f"{drive.law_probability:.2f}"
    return f"{drive.law} ({sure})"


def _unidentifiable(result: ServoIdentification) -> list[str]:
    """Sentences on what is not identifiable, each once, with its joints."""
    from ....servo.identify.flags import by_sentence
    from ....servo.identify.identifiable import COMBINED, IDLE

    return [*by_sentence(result.joints), *(flag for flag in result.flags if IDLE in flag or COMBINED in flag)]


def _probability(value: float | None) -> str:
    if value is None:
        return "-"
    return ">0.999" if value > 0.999 else f"{value:.3f}" if value >= 0.0005 else "<0.001"


def _models(result: ServoIdentification, pages: bool) -> Section:
    """A row per friction model: errors of whole recordings, evidence, time; on pages with its numbers by joint."""
    heads = ("model", "has", "mean |error|>", "rms>", "log Bayes factor>", "probability>", "processor s>")
    rows, by_joint = [], []
    for model in result.friction_models:
        errors = (_by_unit(result.rollout, x) for x in (model.mean_absolute, model.rms))
        probability = "-" if np.isnan(model.probability) else f"{model.probability:.2f}"
        evidence = (f"{model.log_bayes_factor:.1f}", probability, f"{model.seconds:.1f}")
        rows.append((model.name, model.terms, *errors, *evidence))
        for joint, numbers in model.numbers.items():
            shown = [_quantity(x, joint).displayed() for x in numbers.values()]
            known = ", ".join(f"{spaced(x.name)} {x.cell} {x.unit}".rstrip() for x in shown if x.known)
            by_joint.append((model.name, joint, known, ", ".join(spaced(x.name) for x in shown if not x.known)))
    blocks: tuple[Block, ...] = (Cells(heads, rows),) if rows else ()
    if pages and by_joint:
        numbers_heads = ("model", "joint", "numbers, ± 95 %", "not identifiable")
        blocks = (*blocks, Cells(numbers_heads, by_joint), Legend(FRICTION_MODELS_LEGEND))
    return Section(f"Friction models: errors from commands alone, {_rows_of(result.rollout)}", blocks)


def _rows_of(rollout: ServoRollOut) -> str:
    return "held-out data" if rollout.held_out else "data of the fit (none was held out)"


def _by_unit(rollout: ServoRollOut, errors: Array) -> str:
    """Mean error of the joints of each unit; "-" where it diverges."""
    by_unit = {unit: errors[[u == unit for u in rollout.units]] for unit in dict.fromkeys(rollout.units)}
    means = {unit: x[~np.isnan(x)] for unit, x in by_unit.items()}
    return ", ".join(f"{thousandths(float(np.mean(x)))} m{unit}" for unit, x in means.items() if x.size)
