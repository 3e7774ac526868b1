"""Recordings of commands and positions -> drives of a robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ...deadline import ends_in_time, time_is_up
from ...errors import shorten
from ...faults.commands import audit_flags
from ...faults.commands.response import content_rate
from ...model import Model, ModelSource, as_model, command_model
from ...recording import Recordings, as_recordings
from ...regression.session import only_once
from ...robot import as_robot
from ...robot.joints import similar_joints
from ...servos import Servo, ServoGrid
from ...typed import typed
from ...types import Array, Progress, Recording
from ..fit import ServoFit, fit_servos, start_servos
from ..given import OWN, given_texts
from ..plant.course import FIT_SUBSTEP, bodies_of
from ..search.choice import LOUDER, Candidate, ServoTrial, improved, supported, worth
from ..search.data import ServoData, loop_error, servo_data, thinned
from ..search.laws import rare_limits, try_laws
from ..search.searcher import FIRST, Chosen, KnownLimits, Searcher, ServoOptions
from ..zeros.run import P_SIGN, JointZero, find_zeros, turns
from .conclude import JudgedFit, Known, conclude, facts_of, judge
from .facts import exceeded, full_duty_errors
from .fits import final_fit, own_numbers, weigh_bodies, whole_rms
from .flags import worse_than_stated
from .identifiable import RARE
from .result import LoggedRows, ServoIdentification
from .scale import Stated, connected_sets, first_candidate, stated_laws, stated_numbers

ALONE, COUPLED = 1.0, 0.8  # [s] of windows; shorter ones do not identify limits (BAM XL330, Go2)
PLAIN = "duty"  # its regression has one number less
FINER = 0.7  # rows of the log over those of the grid [1], below which the grid averages known changes of commands
SEARCHED, FITTED = 60_000, 180_000  # substeps times squared joints of a branch
LEAST_SHARE, LEAST_TIME = 0.1, 10.0  # of the rows, [s] a joint of a branch: the less of both is fitted (SO-101)
NOT_REFITTED = "the model was not fitted again to the held-out rows"
MOST_JOINTS = 7  # beyond them the search over signs and zeros is too long
UNDECIDED = "no file states it: move the joint by hand, and write scale = 1 or -1 into the column map (--columns)"
PARTS = 4  # of a row
BETWEEN = {2: 0.25, 4: 0.5}  # changes of the command in a row, and shift of what acts in it [rows]; 4: all the time
EVERY = 0.5  # share of rows with a new command, of those while it moves, from which it may change between rows
CHANGE_ROWS = 5  # rows around a change of a command, in which it moves
RMS_GROWTH, GROWTH_ERRORS = 1.05, 2.0  # of rms, and in standard errors over windows, that rule changes between rows out
STEPS = 2  # most iterations of a fit
LINEAR_LAWS = ("effort", "duty")  # the same law while nothing saturates
FIRST_STEPS, LATER_STEPS = 4, 6  # most iterations from a fit with one number less, before it promises something, then
PROMISING = 0.995  # error on the training data after the first of them, over that without the number
RETRY_RATIO = 3.0  # residual over that of a joint that is alike by name, from which its numbers are tried
LOOSE = 0.15  # residual over the error of the loop from which limits are tried before friction


@typed
@ends_in_time
def identify_servos(
    robot: ModelSource,
    recordings: Recordings,
    *,
    held_out: Recordings = (),
    laws: Mapping[str, str] | str | None = None,
    known: str | Sequence[str] | None = None,
    prior: Sequence[str] = (),
    bounds: Sequence[str] = (),
    equal: Sequence[str] = (),
    refit: bool | None = None,
    options: ServoOptions | None = None,
    progress: Progress | None = None,
) -> ServoIdentification:
    """Identify position drives from commanded and measured positions; no torque is needed.

    Once its errors on held-out rows are known, the model is fitted again to all rows, except those of `held_out`.

    Args:
        robot: as `load_robot` gives it, or what it reads; a model counts with its bodies.
        recordings: one recording or several to learn from, with q_des_J of the servo joints.
        held_out: held-out recordings; without any, the last of several recordings or the last 30 % of the only one.
        laws: law of all drives, or by joint: effort, duty or torque_speed. None: as stated, else by evidence.
        known: what sets the scale of torque: "masses" of the description, stated "kp", "kp=20" for all joints, or
            "nothing"; None: stated gains where there are any, else masses. And numbers that are stated instead of
            fitted, any of SERVO_NUMBERS in SERVO_UNITS: "armature=.01", or "armature@.*_hip_joint=.01" for the joints
            whose names a regular expression matches.
        prior: normal priors of numbers, "armature=.01+-.005" (mean and standard deviation), with @PATTERN for some
            joints; such a number is free.
        bounds: ranges of numbers, "kp=5..30", with @PATTERN for some joints.
        equal: regular expressions; the joints whose names one of them matches have the same drive, so all its numbers
            but the torque offset are one number each, fitted to all of them, also in different branches.
        refit: whether the model is fitted again to all rows after its held-out errors are known; None: unless
            held-out recordings are given. It is not if these errors are far above the training errors, or if only
            held-out rows reach a limit.
        options: rate, window, additional numbers and seed.
        progress: called with the current step and the share that is done.

    Raises:
        OptionError: unknown law, joint, scale or number; a text that cannot be read; a pattern of equal joints that
            matches fewer than two; contradictions; a recording given twice.
        RecordingError: no joint has commands, or a recording is too short.
    """
    options = options or ServoOptions()
    model = as_model(robot if isinstance(robot, Model) else as_robot(robot, "identify_servos"), "identify_servos")
    given, unseen = (as_recordings(some, model.robot, "identify_servos") for some in (recordings, held_out))
    only_once((*given, *unseen))
    data = servo_data(model.robot, given, unseen, options.rate)
    stated = stated_numbers(model.robot, data.driven)
    known_of = given_texts(model.robot, data.driven, stated, known=known, prior=prior, bounds=bounds, equal=equal)
    scale, wanted, fixed, assumed = known_of.scale, known_of.stated, known_of.fixed, known_of.assumptions
    law = stated_laws(model.robot, data.driven, laws, assumed)
    sets = connected_sets(model, data.joints, data.driven)
    _say(progress, "starting servos", 0.0)
    size = max(len(members) for members in sets) ** 2
    options = replace(options, window=options.window or (ALONE if size == 1 else COUPLED))
    most, fitted = (rows_used(sets, data, budget) for budget in (SEARCHED, FITTED))
    folds = tuple((thinned(a, most), thinned(b, most)) for a, b in data.folds)
    few = replace(data, train=thinned(data.train, most), folds=folds)
    plain, _ = command_model(model, {joint: Servo() for joint in data.driven}, complete=True)
    starts = {k: {j: x for j, x in start_servos(plain, few.train, k).items() if j in data.driven} for k in LINEAR_LAWS}
    weighed, remarks = plain, tuple[str, ...]()
    if scale == "kp":
        _say(progress, "weighing bodies", 0.05)
        weighed, remarks = weigh_bodies(plain, few, starts[PLAIN], fixed, sets, options)
    duty = _recorded_duty(full_duty_errors(model.robot, given), fixed, law)
    laws_known = {**law, **dict.fromkeys(assumed.with_peers(duty), "duty")}
    first = {k: first_candidate(model.robot, data, x, fixed, laws_known, assumed) for k, x in starts.items()}
    limits = KnownLimits({law: _limited(one, starts[law]) for law, one in first.items()}, laws_known)
    start = replace(first[PLAIN], tied=duty).follow(first[PLAIN].servos)
    first_rows = (recording.read(0, 1).servo for recording in given)
    if any(servo is not None and servo.volt is not None for servo in first_rows):  # takes the place of a droop
        options = replace(options, additional=tuple(name for name in options.additional if name != "droop"))
    chosen = search(Searcher(weighed, few, sets, options, progress, assumed), start, limits)
    _say(progress, "fitting servos", 0.8)
    final = replace(data, train=thinned(data.train, fitted))
    fit = final_fit(weighed, final, chosen.candidate, options)
    tied = {joint: error for joint, error in duty.items() if exceeded(data.train, joint, error) < RARE}
    if reached := [joint for joint in duty if joint not in tied]:
        chosen = replace(chosen, candidate=chosen.candidate.follow(fit.servos).with_limits(reached))
        fit = final_fit(weighed, final, chosen.candidate, options)
    _say(progress, "simulating held-out recordings", 0.9)
    remarks = (*audit_flags(model.robot, (*given, *unseen)), *remarks)
    zeros, notes = joint_zeros(plain, data, starts[PLAIN], options.seed) if scale == "masses" else ((), ())
    remarks = (*remarks, *zero_flags(zeros, dict(zip(given[0].joints, given[0].columns.get("q", ()), strict=False))))
    logs = tuple(map(_logged_rows, (*given, *unseen)))
    slow = FINER * min(log.content_rate for log in logs) < data.train[0].rate
    late = command_timing(weighed, few, fit, options.window) if slow else {}
    own = own_numbers(weighed, few, fit, chosen.candidate, options)
    case = Known(scale, wanted, fixed, limits.laws, tied, sets, late, assumed, own)
    judged = judge((plain, weighed), data, fit, case)
    if (not unseen if refit is None else refit) and data.held_out is not data.train:
        _say(progress, "fitting servos to all rows", 0.95)
        judged, reasons = fitted_again(weighed, judged, chosen.candidate, case, options, fitted)
        notes = (*notes, *reasons)
    found = conclude((plain, weighed), judged, chosen, case, remarks, options)
    return replace(found, logs=logs, zeros=zeros, notes=(*found.notes, *notes))


def rows_used(sets: Sequence[Sequence[str]], data: ServoData, budget: int) -> int:
    """Most rows of a fit within a budget of substeps times squared joints of the largest set, and at least some."""
    joints, grid = max(len(members) for members in sets), data.train[0]
    least = min(LEAST_SHARE * sum(map(len, data.train)), LEAST_TIME * joints * grid.rate)
    return max(budget // (joints**2 * int(np.ceil(grid.step / FIT_SUBSTEP - 1e-9))), int(least * budget / FITTED))


def _logged_rows(recording: Recording) -> LoggedRows:
    """Period of the rows, and rate of those that were neither interpolated nor repeated."""
    x = recording.read()
    known = np.isfinite(x.t) & np.isfinite(x.q).all(axis=1)
    t, q = x.t[known], x.q[known]
    return LoggedRows(recording.path, float(np.median(np.diff(t))), content_rate(t, q))


def _recorded_duty(errors: Mapping[str, float], fixed: Stated, laws: Mapping[str, str]) -> dict[str, float]:
    """Error of full duty [rad or m] of joints whose law and limit are not stated otherwise."""
    return {
        joint: error
        for joint, error in errors.items()
        if laws.get(joint, "duty") == "duty" and "effort_limit" not in fixed.get(joint, {})
    }


def _limited(start: Candidate, found: Mapping[str, Servo]) -> Candidate:
    """Start with the limits that a regression found, unless they are stated."""
    new = {
        joint: servo.with_(effort_limit=servo.kp * found[joint].effort_limit / found[joint].kp)
        for joint, servo in start.servos.items()
        if not servo.effort_limit < np.inf
    }
    return start.changed(new)


def _say(progress: Progress | None, step: str, share: float) -> None:
    if progress is not None:
        progress(step, share)


def fitted_again(
    model: Model, judged: JudgedFit, candidate: Candidate, known: Known, options: ServoOptions, most: int
) -> tuple[JudgedFit, tuple[str, ...]]:
    """The same laws and free numbers, fitted to all rows, with the errors on held-out rows as they were.

    The first fit stays, with a note, where held-out rows show what it has no number for, and where the new one predicts
    them worse. most: rows of the fit.
    """
    first, data = judged.fit, judged.data
    if reasons := tuple(_unlike(judged)):
        return judged, (f"{NOT_REFITTED}: {' and '.join(reasons)}",)
    if worse_than_stated(judged.rollout) or time_is_up("the fit of drives to all rows", answer=False):
        return judged, ()
    everything = replace(data, train=(*data.train, *data.held_out))
    rows = replace(everything, train=thinned(everything.train, most))
    fit = final_fit(model, rows, candidate.follow(first.servos), options)
    before = judged.rollout
    after = replace(before, whole_rms=whole_rms(model, fit.servos, data.held_out))
    worse = not np.nanmean(after.whole_rms**2) <= LOUDER**2 * np.nanmean(before.whole_rms**2)
    if worse or worse_than_stated(after):
        return judged, (f"{NOT_REFITTED}: it would predict them worse from commands alone",)
    facts = {
        joint: replace(fact, torque_off=judged.facts[joint].torque_off)  # by the numbers that are free
        for joint, fact in facts_of(model, everything, fit, known).items()
    }
    return replace(judged, data=everything, fit=fit, facts=facts, refit=True), ()


def _unlike(judged: JudgedFit) -> Iterator[str]:
    """Reasons why held-out rows must not be learned from."""
    if far := [joint for joint, error in judged.errors.items() if error.far]:
        yield f"its errors there are far above those of the training rows ({shorten(far)})"
    if beyond := [joint for joint, fact in judged.facts.items() if fact.held_out_limit < np.inf]:
        yield f"only they reach an effort limit, which the model lacks ({shorten(beyond)})"


def joint_zeros(
    model: Model, data: ServoData, servos: Mapping[str, Servo], seed: int
) -> tuple[tuple[JointZero, ...], tuple[str, ...]]:
    """Sign and zero of each revolute joint with a drive, and notes; servos: drives that start a fit."""
    robot = bodies_of(model, data.joints)
    driven = {joint: servos[joint] for joint in data.driven if joint in servos}
    turning = [joint for j, joint in enumerate(data.joints) if joint in driven and turns(robot, j)]
    if len(turning) > MOST_JOINTS:
        note = f"signs and zeros of positions are not compared with gravity: {len(turning)} joints are too many"
        return (), (note,)
    zeros = find_zeros(robot, data.train, driven, seed)
    lost = [one.joint for one in zeros if not one.identifiable]
    if not lost or not any(one.changed for one in zeros):
        return zeros, ()
    note = f"{shorten(lost)}: sign and zero of the position are not identifiable; gravity hardly depends on them"
    return zeros, (note,)


def zero_flags(zeros: Sequence[JointZero], columns: Mapping[str, str]) -> Iterator[str]:
    """A sentence on each joint whose sign or zero differs from the description; columns: of q, by joint."""
    for one in zeros:
        if not one.changed or one.zero is None or one.std is None:
            continue
        turned = one.sign < 0
        sure = "> 99 %" if one.probability > 0.99 else f"{100 * one.probability:.0f} %"
        scale = "scale = -1, " if turned else ""
        entry = f'q_{one.joint} = {{ column = "{columns.get(one.joint, "...")}", {scale}offset = {one.zero:.4g} }}'
        what = "has the opposite sign, and its zero is" if turned else "has a zero that is"
        unsure = f", whose sign is not sure (probability {one.sign_probability:.2f})," * (one.sign_probability < P_SIGN)
        remedy = (
            f"for positions in rad write {entry}, and q_des_{one.joint} alike, into the column map (--columns), or "
            f"pass the columns.toml that -o writes"
        )
        yield (
            f"{one.joint}: the recorded position{unsure} {what} {one.zero:.3g} ± {1.96 * one.std:.2g} rad off the "
            f"description, by the load of the joints (probability {sure}); nothing was changed, "
            f"and the scale rests on this gravity: {remedy if one.decided else UNDECIDED}"
        )


def command_timing(model: Model, data: ServoData, fit: ServoFit, window: float) -> dict[str, float]:
    """Time [s] by which the delay of each joint may be longer, as its commands may change between rows; 0 if not."""
    suspects = [joint for joint in fit.servos if _changes(data.train, data.joints.index(joint)) > EVERY]
    found = dict.fromkeys(fit.servos, 0.0)
    if not suspects or not fit.names:
        return found
    held = _squares(model, data, fit, 1, window)
    for changes, shift in BETWEEN.items():
        worse = _squares(model, data, fit, changes, window) - held
        for joint in suspects:
            j = data.joints.index(joint)
            own, base = worse[:, j], float(np.mean(held[:, j]))
            error = own.std(ddof=1) / np.sqrt(len(own)) if len(own) > 1 else np.inf
            if not (own.mean() > GROWTH_ERRORS * error and own.mean() > (RMS_GROWTH**2 - 1) * base):
                found[joint] = shift * data.train[0].step
    return found


def _squares(model: Model, data: ServoData, fit: ServoFit, changes: int, window: float) -> Array:
    """Mean squares (W, n) [rad2 or m2] of windows, fitted with a number of `changes` of the command in each row."""
    late = BETWEEN.get(changes, 0.0) * data.train[0].step
    servos = {joint: servo.with_(delay=servo.delay + late) for joint, servo in fit.servos.items()}
    grids = [_refined(grid, changes) for grid in data.train]
    new = fit_servos(
        model,
        grids,
        servos,
        fit.free,
        window=window,
        relinearise=False,
        iterations=STEPS,
        scales=False,
        coarse=True,
    )
    return new.window_squares


def _refined(grid: ServoGrid, changes: int) -> ServoGrid:
    """Grid with PARTS times the rows; positions and commands are interpolated by splines, commands are then held."""
    rows = np.arange(len(grid))
    at = np.arange((len(grid) - 1) * PARTS + 1) / PARTS
    held, kept = np.floor(at * changes + 1e-9) / changes, (at + 1e-9).astype(int)
    speed, forward = grid.command_speed, grid.feed_forward
    return replace(
        grid,
        rate=grid.rate * PARTS,
        q=CubicSpline(rows, grid.q)(at),
        command=grid.command[kept] if changes == 1 else CubicSpline(rows, grid.command)(held),
        on=grid.on[kept],
        voltage=grid.voltage[kept],
        command_speed=None if speed is None else speed[kept],
        feed_forward=None if forward is None else forward[kept],
    )


def _changes(grids: Sequence[ServoGrid], joint: int) -> float:
    """Share of rows with a new command, of those near a change [1]."""
    new = [np.diff(grid.command[:, joint]) != 0 for grid in grids]
    near = [np.convolve(x, np.ones(2 * CHANGE_ROWS + 1), "same") > 0.5 for x in new]
    return float(sum(x.sum() for x in new) / max(sum(x.sum() for x in near), 1))


def search(by: Searcher, start: Candidate, limits: KnownLimits) -> Chosen:
    """Choose laws of joints that no drive without limits explains, load friction, other laws, and other numbers.

    Args:
        by: model, data and options.
        start: drives without limits, unless they are stated or tied to a gain.
        limits: of joints that seem to saturate, and stated laws.
    """
    laws: dict[str, Mapping[str, float]] = {
        joint: {law: 1 / len(LINEAR_LAWS) for law in LINEAR_LAWS} for joint in start.servos if joint not in limits.laws
    }
    by.say("fitting servos without limits", 0.1)
    base = by.fit(start)
    if not by.data.folds:
        return Chosen(base.candidate, laws)
    suspects = by.assumptions.with_peers(limits.joints(start.tied))
    loose = by.near([joint for joint in suspects if base.residual[joint] > LOOSE * loop_error(by.data, joint)])
    if first := [joint for joint in suspects if joint in loose]:
        by.say("trying laws of servos", 0.15)
        base, found = try_laws(by, base, first, limits, loose)
        laws.update({joint: p for joint, p in found.items() if joint not in limits.laws})
    before = base.candidate.free
    if early := by.options.additional[:1] == (FIRST,):
        by.say(f"trying {FIRST} of servos", 0.35)
        base = _try_number(by, base, FIRST)
    tried = base
    by.say("trying limits of servos", 0.4)
    limits, rare = rare_limits(by, base, limits)
    has = [joint for joint in suspects if base.candidate.servos[joint].effort_limit < np.inf]
    if again := [*(joint for joint in has if joint not in loose or base.candidate.free != before), *rare]:
        by.say("trying laws of servos", 0.4)
        base, found = try_laws(by, base, again, limits)
        laws.update({joint: p for joint, p in found.items() if joint not in limits.laws})
    for k, name in enumerate(by.options.additional[int(early and base is tried) :]):
        by.say(f"trying {name} of servos", 0.6 + 0.2 * k / len(by.options.additional))
        base = _try_without(by, _try_number(by, base, name), name)
    base = _like_others(by, base, limits)
    base = by.shorten(base) if base.candidate.window else by.lengthen(base)
    return Chosen(base.candidate, laws)


def _like_others(by: Searcher, base: ServoTrial, limits: KnownLimits) -> ServoTrial:
    """Fit joints again that are fitted far worse than another one alike by name, from its law and numbers."""
    start, again = base.candidate, list[str]()
    for members in similar_joints(tuple(base.residual)):
        best = min(members, key=lambda joint: base.residual[joint])
        like = [number for one, number in base.candidate.free if one == best]
        for joint in (one for one in members if base.residual[one] > RETRY_RATIO * base.residual[best]):
            own = {number for one, number in base.candidate.free if one == joint}
            numbers = {name: getattr(start.servos[best], name) for name in {*own, *like} - {OWN}}
            servo = replace(start.servos[joint], law=limits.laws.get(joint, start.servos[best].law)).with_(**numbers)
            rest = tuple(one for one in start.free if one[0] != joint)
            start, again = (
                replace(start, free=rest).changed({joint: servo}, [(joint, x) for x in like]),
                [*again, joint],
            )
    if not again:
        return base
    near = by.near(again)
    base, new = by.score(base, near), by.score(by.fit(start.only(near), LATER_STEPS), near)
    better = improved(base, new, worth(base, new, again))
    return base.with_joints(new.only(by.near(better))) if better else base


def _try_number(by: Searcher, base: ServoTrial, name: str) -> ServoTrial:
    """Free a number at all joints, and keep it where windows that took no part improve."""
    start, neutral = base.candidate, getattr(Servo(), name)
    joints = [joint for joint, servo in start.servos.items() if getattr(servo, name) == neutral]
    if not joints:
        return base
    first = by.fit(start.changed({}, [(joint, name) for joint in joints]), FIRST_STEPS)
    near = by.near(promising := worth(base, first, joints, PROMISING))
    new = by.fit(start.only(near).changed({}, [(j, name) for j in promising]), LATER_STEPS) if promising else base
    if not (promising := worth(base, new, promising)):
        return base
    base = by.score(base, near)
    new = by.score(new, near)
    kept = supported(by.data, base, new, improved(base, new, promising), joints)
    if not kept:
        return base
    if kept != promising:
        near = by.near(kept)
        new = by.score(by.fit(start.only(near).changed({}, [(joint, name) for joint in kept]), LATER_STEPS), near)
    return base.with_joints(new)


def _try_without(by: Searcher, base: ServoTrial, name: str) -> ServoTrial:
    """Give a free number up where the training data are fitted as well without it, by now that others are free."""
    start, neutral = base.candidate, getattr(Servo(), name)
    joints = [joint for joint, number in start.free if number == name]
    if not joints:
        return base
    plain = start.changed({joint: start.servos[joint].with_(**{name: neutral}) for joint in joints})
    plain = replace(plain, free=tuple(one for one in start.free if one[1] != name))
    new = by.fit(plain.only(by.near(joints)), LATER_STEPS)
    return base if worth(new, base, joints) else base.with_joints(new)
