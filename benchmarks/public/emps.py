"""EMPS, official split: open-loop simulation of position under the drive's force alone (nonlinearbenchmark.org)."""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from signid import identify, load_robot
from signid.effects import EFFECTS
from signid.model import Model, stated_inertials
from signid.regression.session import Options
from signid.simulation.refine import refine
from signid.simulation.refine.fit import LAWS, coordinates_of
from signid.simulation.rollout.whole import roll_out_whole
from signid.types import Law, Recording

from ..real.data import recording
from .rows import JANOT, PUBLISHED, Row

TRAIN, TEST = "emps_train", "emps_pulses"
FRICTION = ("viscous_friction", "coulomb_friction", "torque_offset")


@dataclass(frozen=True)
class Entry:
    """A model that was made without the test file."""

    method: str
    model: Model
    source: str
    seconds: float  # processor time
    trials: tuple[str, ...] = ()  # lines on the choice of laws

    @property
    def digest(self) -> str:
        """SHA-256 of the model.json that the model is saved as."""
        with tempfile.TemporaryDirectory() as folder:
            return hashlib.sha256(self.model.save(Path(folder) / "model.json").read_bytes()).hexdigest()


def entries() -> Iterator[Entry]:
    """Models in the order of the table, made from the training file."""
    train = recording("emps_janot", TRAIN, load_robot("emps"))
    yield Entry("published least squares", published(), JANOT, 0.0)
    start = time.process_time()
    found = identify(load_robot("emps"), [train], options=Options(effects=FRICTION)).model
    spent = time.process_time() - start
    yield Entry("signid identify", found, "signid", spent)
    for method, candidates in (("signid, refined", ()), ("signid, refined, laws chosen", LAWS)):
        start = time.process_time()
        refined = refine(found, [train], candidates=candidates)
        trials = tuple(
            f"{1e3 * x.score:.3f} mm, {x.numbers} numbers: {', '.join(x.laws)}"
            for x in sorted(refined.trials, key=lambda x: x.score)
        )
        yield Entry(method, refined.model, "signid", spent + time.process_time() - start, trials)


def scored(entry: Entry, train: Recording, test: Recording) -> Row:
    """Score of a model: RMSE over all samples but the first 20, which give the start state."""
    errors = [1e3 * float(roll_out_whole(entry.model, one).rms[0]) for one in (train, test)]
    return Row(entry.method, len(coordinates_of(entry.model).value), *errors, entry.source, entry.seconds)


def files() -> tuple[Recording, Recording]:
    """Training and test recording."""
    robot = load_robot("emps")
    return recording("emps_janot", TRAIN, robot), recording("emps_janot", TEST, robot)


def published(mass: float = PUBLISHED["mass"]) -> Model:
    """The published parameters, with another mass [kg] if given."""
    robot = load_robot("emps")
    keys = {"viscous_friction": "coefficient", "coulomb_friction": "level", "torque_offset": "offset"}
    values = (PUBLISHED[key] for key in ("viscous", "coulomb", "offset"))
    laws = tuple(Law(EFFECTS[name], (0,), {key: x}) for (name, key), x in zip(keys.items(), values, strict=True))
    inertials = stated_inertials(robot)
    return Model(robot, inertials * mass / inertials[-1, 0], laws)
