"""Prepared recordings: options, parts, rate and bandwidth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256

import numpy as np

from ..effects import EFFECT_NAMES, EFFECTS
from ..effects.base import ActuatorLaw, RecordingLaw
from ..errors import OptionError, RecordingError
from ..recording import need_constants, need_torque, same_joints
from ..recording.sampling import Sampling, one_after_another, samples, split, survey
from ..robot import hold, resting
from ..robot.dynamics import check_masses
from ..types import Array, Frozen, Input, Law, Progress, Recording, Robot, Samples
from .bandwidth import Band, Decimator, choose_band
from .base_parameters import build_base
from .factors import LAGS, Factors, Weigh, reduce_rows
from .motion import build_motion, margin
from .rows import Rows, Task, choose_reach, consumed, read_rows

Part = tuple[Recording, Sampling]

TRAINING_SHARE = 0.7  # of a single recording
LEARNED, HELD_OUT, REFERENCE = "learned from", "held out", "of the healthy robot"
SHARED = f"learned from, except the last {1 - TRAINING_SHARE:.0%}, which is held out"
BAND_SAMPLES = 2**17  # samples of a recording from which the cut-off is chosen
RATE_TOLERANCE = 0.01  # relative difference that sampling rates of recordings may have
REVERSAL_VELOCITY, REVERSAL_SHARE = 0.01, 0.02  # [rad/s], [rms velocity] width of the reversal of a geared joint
DERIVATIVE_TOLERANCE = 2e-3  # [1] difference from derivatives of the positions, below which recorded ones are used
MIN_REVERSAL_VELOCITY = 1e-12  # [rad/s or m/s] width of a reversal of recordings without encoder noise in velocity
MIN_RECORDING_ROWS = 16  # filtered rows that a recording needs if nothing can be held out of it
SELF_EVALUATION_NOTE = (
    "the recording is too short to hold anything out: the model is evaluated on its own training data, so held-out "
    "errors are too small; record for longer, or give another recording with --held-out"
)
MIN_PARAMETER_ROWS = 20  # rows per parameter; with fewer the noise model is poor
MIN_INERTIAL_CUTOFF = 2.0  # [Hz] below which inertial torque is hardly visible
FILTER_PERIODS = 9.0  # length of both filters together, in periods of the cut-off

Parts = tuple[Part, ...]


@dataclass(frozen=True, eq=False)
class Options(Frozen):
    """Options of the way from recordings to rows. Defaults come from the data.

    >>> found = signid.identify("3r", "robots/3r/recording.parquet", options=signid.Options(robust=True))
    """

    effects: tuple[str, ...] = EFFECT_NAMES
    cutoff: float | None = None  # [Hz]; None: from the encoder noise; inf: no filter
    derivatives: str = "auto"  # "auto", "computed" from q, "recorded" dq and ddq
    instruments: bool = True  # use q_des where every joint has it
    whiten: bool = True  # autoregressive noise; False: white noise per joint
    robust: bool = False  # Huber weights against outliers
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Session(Frozen):
    """One robot's recordings, surveyed and split, and what their rows are made for."""

    task: Task
    train: tuple[Part, ...]
    held_out: tuple[Part, ...]  # the same object as `train` where nothing is held out
    notes: tuple[str, ...]
    given: tuple[tuple[Part, ...], tuple[Part, ...]] = ((), ())  # whole recordings: to learn from, and to hold out
    options: Options = Options()

    @property
    def robot(self) -> Robot:
        """The robot with the joints held that the recordings do not move."""
        return self.task.robot

    @property
    def whole(self) -> tuple[Part, ...]:
        """Every recording once, not split, in the order in which it was given."""
        return tuple(dict((*self.given[0], *self.given[1])).items())

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """Every recording once, in the order in which it was given."""
        return tuple(recording for recording, _ in self.whole)

    @property
    def signed(self) -> bool:
        """Whether every torque has its sign."""
        return all(recording.signed.all() for recording in self.recordings)

    @property
    def learned(self) -> tuple[Part, ...]:
        """The recordings of which at least a part is learned from, not split."""
        train = {recording for recording, _ in self.train}
        return tuple(part for part in self.whole if part[0] in train)

    def exchange(self, new: Mapping[Recording, Recording]) -> Session:
        """The same with other recordings of the same rows in the place of some."""
        train, held_out, *given = (
            tuple((new.get(recording, recording), sampling) for recording, sampling in parts)
            for parts in (self.train, self.held_out, *self.given)
        )
        held_out = train if self.judges_itself else held_out
        return replace(self, train=train, held_out=held_out, given=(given[0], given[1]))

    @property
    def judges_itself(self) -> bool:
        """Whether nothing is held out: the training data serve for evaluation as well."""
        return bool(self.train) and self.held_out is self.train

    def reduce(
        self,
        parts: Sequence[Part],
        weigh: Weigh | None = None,
        progress: Progress | None = None,
        purpose: str = "learning from",
        lags: int = LAGS,
    ) -> Factors:
        """Factors of some of its recordings, in one pass.

        Raises:
            RecordingError: every stretch of the recordings is shorter than the filter.
        """
        sums = [(p, reduce_rows(self.task, _rows_of_part(self.task, p, progress, purpose), lags, weigh)) for p in parts]
        found = [replace(factors, parts=((part[0].sha256, factors),)) for part, factors in sums if factors.rows]
        if not found:
            band, these = self.task.band, "what is held out" if parts is self.held_out else "the recordings"
            raise RecordingError(
                f"no stretch of {these} is as long as the filter for {band.cutoff:.3g} Hz "
                f"({len(band.taps) / band.rate:.2g} s); record for longer, or raise the cut-off"
            )
        return sum(found[1:], found[0])


def longest_piece(part: Part, most: int = BAND_SAMPLES) -> Samples:
    """The longest stretch of a recording without a gap, or its beginning where that is very long."""
    recording, sampling = part
    span = max(sampling.spans, key=sampling.length)
    return samples(recording, sampling, span, 0, min(sampling.length(span), most))


def common_rate(parts: Sequence[Part], advice: str) -> float:
    """The sampling rate of all recordings [Hz].

    Raises:
        RecordingError: they differ; the sentence ends with the advice.
    """
    rates = np.array([1 / sampling.period for _, sampling in parts])
    if np.ptp(rates) > RATE_TOLERANCE * rates.min():
        listed = ", ".join(f"{rate:.6g} Hz" for rate in rates)
        raise RecordingError(f"the recordings are sampled at different rates ({listed}); {advice}")
    return float(rates[0])


def recordings_used(
    recordings: Sequence[Recording], held_out: Sequence[Recording], reference: Sequence[Recording] = ()
) -> tuple[Input, ...]:
    """Recordings with their roles, as a session splits them; reference recordings are of the healthy robot."""
    parts = [(LEARNED, recordings[:-1]), (HELD_OUT, recordings[-1:])] if len(recordings) > 1 else [(SHARED, recordings)]
    parts = [(LEARNED, recordings), (HELD_OUT, held_out)] if held_out else parts
    roles = {(r.path, r.sha256): role for role, some in [*parts, (REFERENCE, reference)] for r in some}
    read = {r.reading.path: r.reading.text for r in (*recordings, *held_out, *reference) if r.reading}
    files = (Input(path, sha256(text.encode()).hexdigest(), "reading") for path, text in read.items() if path)
    return (*(Input(path, digest, f"recording, {role}") for (path, digest), role in roles.items()), *files)


def only_once(recordings: Sequence[Recording]) -> None:
    """Check that each recording was given once.

    Raises:
        OptionError: one was given twice, perhaps under two names.
    """
    seen: dict[str, str] = {}
    for recording in recordings:
        if recording.sha256 in seen:
            one, other = recording.path or "one recording", seen[recording.sha256] or "another"
            raise OptionError(
                f"{one} holds the same samples as {other}; give each recording once, to learn from or as held out"
            )
        seen[recording.sha256] = recording.path


def _rows_of_part(task: Task, part: Part, progress: Progress | None, purpose: str) -> Iterator[Rows]:
    recording, sampling = part
    total = max(1, sum(sampling.length(span) for span in sampling.spans) // task.band.factor)
    done = 0
    for rows in read_rows(task, recording, sampling):
        yield rows
        done += len(rows.t)
        if progress is not None:
            progress(f"{purpose} {recording.path or 'recording'}", min(1.0, done / total))


def prepare(
    robot: Robot,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    options: Options | None = None,
    *,
    scaled: bool = True,
) -> Session:
    """Prepare a session: joints, laws, base map, band and the split into training and held-out recordings.

    Without held-out recordings the last of several is held out, or the last 30 % of the only one. Nothing is held out
    of an only recording that is too short for that. Unless `scaled`, currents without torque constants are accepted.

    Raises:
        RecordingError: a recording cannot be used, or recordings do not fit together.
        OptionError: an effect or an option is unknown.
        RobotError: a moving body has a negative mass.
    """
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    whole = [*recordings, *held_out]
    need_torque(whole)
    if scaled:
        need_constants(whole)
    check_masses(robot)
    moving = hold(robot, resting(robot, but=same_joints(whole)))
    surveys = {recording: survey(recording, moving) for recording in dict.fromkeys(whole)}
    surveys = dict(zip(surveys, one_after_another(list(surveys.values())), strict=True))
    learn, judge = (tuple((r, surveys[r]) for r in role) for role in (recordings, held_out))
    return _arrange(moving, (learn, judge), options or Options(), robot.notes)


def rearrange(robot: Robot, session: Session, options: Options) -> Session:
    """The same recordings with other options: effects, cut-off and the like. No recording is read as a whole again."""
    return _arrange(session.robot, session.given, options, robot.notes)


def _arrange(robot: Robot, given: tuple[Parts, Parts], options: Options, notes: Sequence[str]) -> Session:
    """Band, base map and split of recordings that were surveyed."""
    (learn, _), whole = given, tuple(dict((*given[0], *given[1])).items())
    if static := any(r.static for r, _ in whole):
        options = _rest_options(whole, options)
    once = tuple(dict(learn).items())
    band = _common_band(once, options)
    if static:
        nothing = np.zeros_like(band.per_joint)
        band = replace(band, per_joint=nothing + np.inf, velocity_noise=nothing, torque_floor=nothing)
    train, test = _split_parts(*given, band)
    measured = [all(r.columns["tau"][j] for r, _ in whole) for j in range(len(robot.joints))]
    laws = tuple(Law(EFFECTS[name], (j,)) for name in options.effects for j in np.flatnonzero(measured).tolist())
    _check_linear(laws)
    recorded = _use_recorded(robot, whole, band, options)
    desired = options.instruments and not recorded and all(_wholly(r, "q_des") for r, _ in whole)
    complete = desired and all(_complete(part, "q_des") for part in whole)
    # width of a reversal (n,) [rad/s or m/s]: of the gear for revolute joints, of the encoder noise for all
    speed = np.sqrt(np.mean([sampling.speed**2 for _, sampling in whole], axis=0))
    gear = np.where(robot.prismatic, 0.0, np.minimum(REVERSAL_VELOCITY, REVERSAL_SHARE * speed))
    slow = np.maximum(np.maximum(gear, band.velocity_noise), MIN_REVERSAL_VELOCITY)
    slow = np.full(len(slow), MIN_REVERSAL_VELOCITY) if static else slow
    pieces = [(longest_piece(part, BAND_SAMPLES // 4), part[1].period) for part in once]
    long = [(piece, period) for piece, period in pieces if len(piece.t) > 2 * margin(band) + 1]
    base = build_base(robot, laws, options.seed, measured, static)
    reach = choose_reach([build_motion(robot, piece, band, period) for piece, period in long], band, slow)
    task = Task(robot, laws, base, band, slow, reach, recorded, complete)
    said = [f"{r.path or 'recording'}: {note}" for r, sampling in whole for note in (*r.notes, *sampling.notes)]
    said += [SELF_EVALUATION_NOTE] * (train is test)
    if recorded and not static:
        said.append("velocities and accelerations are taken as recorded: they agree with the positions")
    if desired and not complete:
        said.append("desired positions have gaps where the measured ones have none: they do not serve as instruments")
    return Session(task, train, test, (*notes, *dict.fromkeys(said)), given, options)


def _rest_options(whole: Parts, options: Options) -> Options:
    """Options of rows at rest: no filter, no law of velocity, Coulomb friction where approaches are known.

    Raises:
        RecordingError: a recording is of motion.
    """
    if not all(recording.static for recording, _ in whole):
        moving = next(recording.path for recording, _ in whole if not recording.static)
        fault = f"{moving or 'a recording'} is of motion, another of postures at rest, a row each"
        raise RecordingError(f"{fault}; identify them apart")
    approach = all("at rest" not in recording.columns["dq"] for recording, _ in whole)
    left = {"viscous_friction", "armature", *(() if approach else ("coulomb_friction",))}
    effects = tuple(name for name in options.effects if name not in left)
    return replace(options, effects=effects, cutoff=np.inf, derivatives="recorded", instruments=False, whiten=False)


def _split_parts(train: Parts, test: Parts, band: Band) -> tuple[Parts, Parts]:
    """Training and held-out parts; the same object where an only recording is too short for both."""
    if test:
        return train, test
    if len(train) > 1:
        return train[:-1], train[-1:]
    recording, sampling = train[0]
    first, last = split(sampling, TRAINING_SHARE)
    if _count_rows(last, band) == 0 and _count_rows(sampling, band) >= MIN_RECORDING_ROWS:
        return train, train
    return ((recording, first),), ((recording, last),)


def _count_rows(sampling: Sampling, band: Band) -> int:
    """About how many filtered rows a recording gives."""
    lengths = (sampling.length(span) - consumed(band) - 1 for span in sampling.spans)
    return sum(max(0, length) // band.factor for length in lengths)


def _common_band(parts: Sequence[Part], options: Options) -> Band:
    rate = common_rate(parts, "resample them to one rate")
    if options.cutoff is not None and not options.cutoff > 0:
        raise OptionError(f"the cut-off is {options.cutoff:g} Hz; a positive frequency is needed")
    longest = max(sampling.length(span) * sampling.period for _, sampling in parts for span in sampling.spans)
    if options.cutoff is not None and FILTER_PERIODS / options.cutoff > longest:
        raise OptionError(
            f"a cut-off of {options.cutoff:g} Hz needs {FILTER_PERIODS / options.cutoff:.3g} s without a gap, but the "
            f"longest stretch lasts {longest:.3g} s; raise the cut-off"
        )
    return choose_band([longest_piece(part) for part in parts], rate, options.cutoff)


def _check_linear(laws: Sequence[Law]) -> None:
    for law in laws:
        effect, linear = law.effect, law.effect.linear()
        shaped = [key for key in effect.parameters if key not in linear]
        cannot = "which least squares cannot fit; choose effects that are linear in all parameters"
        if effect.scope != "joint":
            why = "acts on more than one joint, where least squares does not place it; choose effects of single joints"
        elif isinstance(effect, RecordingLaw | ActuatorLaw):
            why = (
                "changes what torque is recorded or applied, not what the motion takes; choose effects that take torque"
            )
        elif shaped:
            why = f"has the shape parameters {', '.join(shaped)}, {cannot}"
        elif len(effect.coefficients(effect.example)) > len(linear):
            why = f"is not linear in {', '.join(linear)}, {cannot}"
        else:
            continue
        raise OptionError(f"effect {effect.name!r} {why}")


def _wholly(recording: Recording, key: str) -> bool:
    return all(recording.columns.get(key, ("",)))


def _use_recorded(robot: Robot, parts: Sequence[Part], band: Band, options: Options) -> bool:
    """Whether dq and ddq are taken as recorded: asked for, or they are plainly the derivatives of q."""
    if options.derivatives not in ("auto", "computed", "recorded"):
        raise OptionError(f"derivatives {options.derivatives!r} is none of auto, computed, recorded")
    if options.derivatives == "computed":
        return False
    has = all(_wholly(part[0], key) and _complete(part, key) for part in parts for key in ("dq", "ddq"))
    if options.derivatives == "recorded" and not has:
        raise OptionError(
            "derivatives 'recorded' was asked for; not every joint has dq_J and ddq_J columns without gaps"
        )
    return has and (options.derivatives == "recorded" or all(_derivatives_agree(robot, part, band) for part in parts))


def _complete(part: Part, key: str) -> bool:
    """Whether a signal is there wherever the recording is used."""
    recording, sampling = part
    if sampling.incomplete.isdisjoint(recording.columns[key]):
        return True
    pieces = (
        samples(recording, sampling, span, start, min(start + BAND_SAMPLES, sampling.length(span)))
        for span in sampling.spans
        for start in range(0, sampling.length(span), BAND_SAMPLES)
    )
    return all(np.all(np.isfinite(getattr(piece, key))) for piece in pieces)


def _derivatives_agree(robot: Robot, part: Part, band: Band) -> bool:
    """Whether recorded derivatives and those of the positions are the same inside the band."""
    piece, period = longest_piece(part), part[1].period
    computed, recorded = (build_motion(robot, piece, band, period, choice) for choice in (False, True))
    edge = (len(recorded) - len(computed)) // 2
    thin = Decimator(band.taps, band.factor)
    for derivative, stated in ((computed.v, recorded.v), (computed.a, recorded.a)):
        ours, other = thin(derivative), thin(stated[edge : len(stated) - edge])
        if not len(ours) or np.linalg.norm(ours - other) > DERIVATIVE_TOLERANCE * np.linalg.norm(ours):
            return False
    return True


def advice_on_rows(session: Session, factors: Factors, used: Array) -> tuple[str, ...]:
    """Sentences on what would give more or better rows; used: (n,) [1] share of the rows away from reversals."""
    band, robot, said = session.task.band, session.robot, []
    if band.cutoff < MIN_INERTIAL_CUTOFF:
        worst = robot.joints[int(np.argmin(band.per_joint))]
        limit = f"encoder noise of {worst} allows only {band.cutoff:.2g} Hz"
        said.append(f"{limit}: move faster, or record finer positions")
    slow = [(joint, x) for joint, x in zip(robot.joints, used, strict=True) if 0 < x < 0.3]
    said += [f"{joint} keeps {x:.0%} of its rows, the others are near a reversal: move it faster" for joint, x in slow]
    bare = [joint for joint, f in zip(robot.joints, factors.joints, strict=True) if f.rows == 0]
    said += [f"{j} has no usable torque: only parameters that act on other joints are identifiable" for j in bare]
    if factors.rows < MIN_PARAMETER_ROWS * session.task.base.rank / max(len(robot.joints), 1):
        said.append(f"{factors.rows} filtered rows for {session.task.base.rank} parameters are few: record for longer")
    return tuple(said)
