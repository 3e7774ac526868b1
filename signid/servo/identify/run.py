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
from ..given import UNSHARED, Assumptions, given_texts
from ..plant.course import FIT_SUBSTEP, RobotCourse, bodies_of, course, motion_of
from ..search.choice import (
    EARLY_NUMBER,
    MAX_RMS_GROWTH,
    Candidate,
    ServoOptions,
    ServoProblem,
    ServoTrial,
    improved,
    supported,
    worth,
)
from ..search.data import ServoData, loop_error, servo_data, thinned
from ..search.laws import rare_limits, try_laws
from ..zeros.run import P_SIGN, JointZero, find_zeros, turns
from .conclude import JudgedFit, conclude, judge
from .fits import (
    connected_sets,
    final_fit,
    first_candidate,
    own_numbers,
    stated_laws,
    stated_numbers,
    weigh_bodies,
    whole_rms,
)
from .flags import worse_than_stated
from .identifiable import RARE, exceeded, facts_of, full_duty_errors
from .result import LoggedRows, ServoIdentification

WINDOW_ALONE, WINDOW_COUPLED = 1.0, 0.8  # [s] of windows; shorter ones do not identify limits (BAM XL330, Go2)
START_LAW = "duty"  # its regression has one number less
MAX_CONTENT_RATIO = 0.7  # [1] rows of the log over those of the grid, below which the grid averages known changes
SEARCH_BUDGET, FIT_BUDGET = 60_000, 180_000  # substeps times squared joints of a branch
LEAST_SHARE, LEAST_TIME = 0.1, 10.0  # of the rows, [s] a joint of a branch: the less of both is fitted (SO-101)
NOT_REFITTED = "the model was not fitted again to the held-out rows"
MOST_JOINTS = 7  # beyond them the search over signs and zeros is too long
UNDECIDED = "no file states it: move the joint by hand, and write scale = 1 or -1 into the column map (--columns)"
ROW_PARTS = 4  # of a row
CHANGES_PER_ROW = {2: 0.25, 4: 0.5}  # changes of the command in a row, and shift of what acts [rows]; 4: always
CHANGE_SHARE = 0.5  # share of rows with a new command, of those while it moves, from which it may change between rows
CHANGE_ROWS = 5  # rows around a change of a command, in which it moves
RMS_GROWTH, GROWTH_ERRORS = 1.05, 2.0  # of rms, and in standard errors over windows, that rule changes between rows out
TIMING_STEPS = 2  # most iterations of a fit
LINEAR_LAWS = ("effort", "duty")  # the same law while nothing saturates
FIRST_STEPS, LATER_STEPS = 4, 6  # most iterations from a fit with one number less, before it promises something, then
PROMISING = 0.995  # error on the training data after the first of them, over that without the number
RETRY_RATIO = 3.0  # residual over that of a joint that is alike by name, from which its numbers are tried
LIGHT_PERIOD = 0.03  # [s] sqrt(armature / kp) of a light rotor
LIMIT_ERROR_RATIO = 0.15  # residual over the error of the loop from which limits are tried before friction


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
    model = as_model(robot if isinstance(robot, Model) else as_robot(robot, "identify_servos"), "identify_servos")
    given, unseen = (as_recordings(source, model.robot, "identify_servos") for source in (recordings, held_out))
    only_once((*given, *unseen))
    options = options or ServoOptions()
    data = servo_data(model.robot, given, unseen, options.rate)
    stated = stated_numbers(model.robot, data.driven)
    assumed = given_texts(model.robot, data.driven, stated, known=known, prior=prior, bounds=bounds, equal=equal)
    assumed = replace(assumed, laws=stated_laws(model.robot, data.driven, laws, assumed))
    problem = start_fit(model, data, assumed, options, given, progress)
    problem = weigh_bodies(problem)
    trial = search(problem)
    problem, trial, fit = fit_chosen(problem, trial)
    zeros, notes = joint_zeros(problem)
    columns = dict(zip(given[0].joints, given[0].columns.get("q", ()), strict=False))
    said = *audit_flags(model.robot, (*given, *unseen)), *problem.flags, *zero_flags(zeros, columns)
    logs = tuple(map(_logged_rows, (*given, *unseen)))
    problem = compare_assumptions(replace(problem, flags=said), trial, fit, min(log.content_rate for log in logs))
    judged = judge(problem, fit)
    if not unseen if refit is None else refit:
        judged = fit_again(problem, judged, trial.candidate)
    result = conclude(problem, judged, trial)
    return replace(result, logs=logs, zeros=zeros, notes=(*result.notes, *notes, *judged.notes))


def start_fit(
    model: Model,
    data: ServoData,
    assumed: Assumptions,
    options: ServoOptions,
    recordings: Sequence[Recording],
    progress: Progress | None,
) -> ServoProblem:
    """Problem with drives to start from, by regression, and the rows that a search can take."""
    sets = connected_sets(model, data.joints, data.driven)
    alone = max(map(len, sets)) == 1
    options = replace(options, window=options.window or (WINDOW_ALONE if alone else WINDOW_COUPLED))
    first_rows = (recording.read(0, 1).servo for recording in recordings)
    if any(servo is not None and servo.volt is not None for servo in first_rows):  # takes the place of a droop
        options = replace(options, additional=tuple(name for name in options.additional if name != "droop"))
    full_duty = {
        joint: error
        for joint, error in full_duty_errors(model.robot, recordings).items()
        if assumed.laws.get(joint, "duty") == "duty" and "effort_limit" not in assumed.fixed.get(joint, {})
    }
    assumed = replace(assumed, laws={**assumed.laws, **dict.fromkeys(assumed.with_peers(full_duty), "duty")})
    most = rows_used(sets, data, SEARCH_BUDGET)
    folds = tuple((thinned(a, most), thinned(b, most)) for a, b in data.folds)
    searched = replace(data, train=thinned(data.train, most), folds=folds)
    plain, _ = command_model(model, {joint: Servo() for joint in data.driven}, complete=True)
    problem = ServoProblem(plain, plain, data, searched, sets, assumed, options, progress, full_duty=full_duty)
    problem.say("starting servos", 0.0)
    limited = {}
    for law in LINEAR_LAWS:
        by_joint = start_servos(plain, searched.train, law)
        regressed = {joint: servo for joint, servo in by_joint.items() if joint in data.driven}
        start = first_candidate(model.robot, data, regressed, assumed)
        limits = {
            joint: servo.with_(effort_limit=servo.kp * regressed[joint].effort_limit / regressed[joint].kp)
            for joint, servo in start.servos.items()
            if not servo.effort_limit < np.inf
        }
        limited[law] = start.changed(limits)
        if law == START_LAW:
            start = replace(start, tied=full_duty).follow(start.servos)
            problem = replace(problem, regressed=regressed, start=start)
    return replace(problem, limited=limited)


def rows_used(sets: Sequence[Sequence[str]], data: ServoData, budget: int) -> int:
    """Most rows of a fit within a budget of substeps times squared joints of the largest set, and at least some."""
    joints, grid = max(len(members) for members in sets), data.train[0]
    least = min(LEAST_SHARE * sum(map(len, data.train)), LEAST_TIME * joints * grid.rate)
    return max(budget // (joints**2 * int(np.ceil(grid.step / FIT_SUBSTEP - 1e-9))), int(least * budget / FIT_BUDGET))


def _logged_rows(recording: Recording) -> LoggedRows:
    """Period of the rows, and rate of those that were neither interpolated nor repeated."""
    x = recording.read()
    known = np.isfinite(x.t) & np.isfinite(x.q).all(axis=1)
    t, q = x.t[known], x.q[known]
    return LoggedRows(recording.path, float(np.median(np.diff(t))), content_rate(t, q))


def fit_chosen(problem: ServoProblem, trial: ServoTrial) -> tuple[ServoProblem, ServoTrial, ServoFit]:
    """Chosen laws and numbers, fitted to more rows than the search; limits that many rows reach are fitted, too."""
    problem.say("fitting servos", 0.8)
    final = replace(problem.data, train=thinned(problem.data.train, rows_used(problem.sets, problem.data, FIT_BUDGET)))
    fit = final_fit(problem, final, trial.candidate)
    rare = {j: error for j, error in problem.full_duty.items() if exceeded(problem.data.train, j, error) < RARE}
    if reached := [joint for joint in problem.full_duty if joint not in rare]:
        trial = replace(trial, candidate=trial.candidate.follow(fit.servos).with_limits(reached))
        fit = final_fit(problem, final, trial.candidate)
    return replace(problem, full_duty=rare), trial, fit


def compare_assumptions(problem: ServoProblem, trial: ServoTrial, fit: ServoFit, content_rate: float) -> ServoProblem:
    """Problem with the fits beside the chosen one: with commands that change between rows, and without equal joints.

    content_rate: the least of the recordings [Hz].
    """
    slow = MAX_CONTENT_RATIO * content_rate < problem.data.train[0].rate
    timing = command_timing(problem, fit) if slow else {}
    return replace(problem, command_timing=timing, unequal=own_numbers(problem, fit, trial.candidate))


def fit_again(problem: ServoProblem, judged: JudgedFit, candidate: Candidate) -> JudgedFit:
    """The same laws and free numbers, fitted to all rows, with the errors on held-out rows as they were.

    The first fit stays, with a note, where held-out rows show what it has no number for, and where the new one predicts
    them worse.
    """
    data, before = problem.data, judged.rollout
    if data.held_out is data.train:
        return judged
    problem.say("fitting servos to all rows", 0.95)
    reasons = list[str]()
    if far := [joint for joint, error in judged.errors.items() if error.far]:
        reasons.append(f"its errors there are far above those of the training rows ({shorten(far)})")
    if beyond := [joint for joint, fact in judged.facts.items() if fact.held_out_limit < np.inf]:
        reasons.append(f"only they reach an effort limit, which the model lacks ({shorten(beyond)})")
    if reasons:
        return replace(judged, notes=(f"{NOT_REFITTED}: {' and '.join(reasons)}",))
    if worse_than_stated(before) or time_is_up("the fit of drives to all rows", answer=False):
        return judged
    everything = replace(data, train=(*data.train, *data.held_out))
    rows = replace(everything, train=thinned(everything.train, rows_used(problem.sets, data, FIT_BUDGET)))
    fit = final_fit(problem, rows, candidate.follow(judged.fit.servos))
    after = replace(before, whole_rms=whole_rms(problem.model, fit.servos, data.held_out))
    worse = not np.nanmean(after.whole_rms**2) <= MAX_RMS_GROWTH**2 * np.nanmean(before.whole_rms**2)
    if worse or worse_than_stated(after):
        return replace(judged, notes=(f"{NOT_REFITTED}: it would predict them worse from commands alone",))
    facts = {
        joint: replace(fact, torque_off=judged.facts[joint].torque_off)  # by the numbers that are free
        for joint, fact in facts_of(replace(problem, data=everything), fit).items()
    }
    return replace(judged, data=everything, fit=fit, facts=facts, refit=True)


def joint_zeros(problem: ServoProblem) -> tuple[tuple[JointZero, ...], tuple[str, ...]]:
    """Sign and zero of each revolute joint with a drive where masses set the scale, and notes."""
    problem.say("simulating held-out recordings", 0.9)
    if problem.assumptions.scale != "masses":
        return (), ()
    data, robot = problem.data, bodies_of(problem.described, problem.data.joints)
    driven = {joint: problem.regressed[joint] for joint in data.driven if joint in problem.regressed}
    turning = [joint for j, joint in enumerate(data.joints) if joint in driven and turns(robot, j)]
    if len(turning) > MOST_JOINTS:
        note = f"signs and zeros of positions are not compared with gravity: {len(turning)} joints are too many"
        return (), (note,)
    zeros = find_zeros(robot, data.train, driven, problem.options.seed)
    lost = [zero.joint for zero in zeros if not zero.identifiable]
    if not lost or not any(zero.changed for zero in zeros):
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


def command_timing(problem: ServoProblem, fit: ServoFit) -> dict[str, float]:
    """Time [s] by which the delay of each joint may be longer, as its commands may change between rows; 0 if not."""
    data, suspects, longer = problem.searched, list[str](), dict.fromkeys(fit.servos, 0.0)
    for joint in fit.servos:
        new = [np.diff(grid.command[:, data.joints.index(joint)]) != 0 for grid in data.train]
        near = [np.convolve(x, np.ones(2 * CHANGE_ROWS + 1), "same") > 0.5 for x in new]
        if sum(x.sum() for x in new) > CHANGE_SHARE * max(sum(x.sum() for x in near), 1):
            suspects.append(joint)
    if not suspects or not fit.names:
        return longer
    courses = tuple(course(bodies_of(problem.model, data.joints), motion_of(_refined(x, 1))) for x in data.train)
    held = _squares(problem, fit, 1, courses)
    for changes, shift in CHANGES_PER_ROW.items():
        worse = _squares(problem, fit, changes, courses) - held
        for joint in suspects:
            j = data.joints.index(joint)
            growth, base = worse[:, j], float(np.mean(held[:, j]))
            error = growth.std(ddof=1) / np.sqrt(len(growth)) if len(growth) > 1 else np.inf
            if not (growth.mean() > GROWTH_ERRORS * error and growth.mean() > (RMS_GROWTH**2 - 1) * base):
                longer[joint] = shift * data.train[0].step
    return longer


def _squares(problem: ServoProblem, fit: ServoFit, changes: int, courses: Sequence[RobotCourse]) -> Array:
    """Mean squares (W, n) [rad2 or m2] of windows, fitted with a number of `changes` of the command in each row."""
    grids = problem.searched.train
    late = CHANGES_PER_ROW.get(changes, 0.0) * grids[0].step
    servos = {joint: servo.with_(delay=servo.delay + late) for joint, servo in fit.servos.items()}
    new = fit_servos(
        problem.model,
        [_refined(grid, changes) for grid in grids],
        servos,
        fit.free,
        window=problem.options.window,
        relinearise=False,
        iterations=TIMING_STEPS,
        scales=False,
        coarse=True,
        courses=courses,
    )
    return new.window_squares


def _refined(grid: ServoGrid, changes: int) -> ServoGrid:
    """Grid with ROW_PARTS times the rows; positions and commands are interpolated by splines, commands then held."""
    rows = np.arange(len(grid))
    at = np.arange((len(grid) - 1) * ROW_PARTS + 1) / ROW_PARTS
    held, kept = np.floor(at * changes + 1e-9) / changes, (at + 1e-9).astype(int)
    speed, forward = grid.command_speed, grid.feed_forward
    return replace(
        grid,
        rate=grid.rate * ROW_PARTS,
        q=CubicSpline(rows, grid.q)(at),
        command=grid.command[kept] if changes == 1 else CubicSpline(rows, grid.command)(held),
        on=grid.on[kept],
        voltage=grid.voltage[kept],
        command_speed=None if speed is None else speed[kept],
        feed_forward=None if forward is None else forward[kept],
    )


def search(by: ServoProblem) -> ServoTrial:
    """Choose laws of joints that no drive without limits explains, load friction, other laws, and other numbers."""
    by.say("fitting servos without limits", 0.1)
    free_laws = [joint for joint in by.start.servos if joint not in by.assumptions.laws]
    base = replace(_fit_starts(by), laws=dict.fromkeys(free_laws, dict.fromkeys(LINEAR_LAWS, 1 / len(LINEAR_LAWS))))
    if not by.searched.folds:
        return base
    suspects = by.saturating()
    large = [joint for joint in suspects if base.residual[joint] > LIMIT_ERROR_RATIO * loop_error(by.searched, joint)]
    loose = by.near(large)
    if first := [joint for joint in suspects if joint in loose]:
        by.say("trying laws of servos", 0.15)
        base = try_laws(by, base, first, loose)
    before = base.candidate.free
    if early := by.options.additional[:1] == (EARLY_NUMBER,):
        by.say(f"trying {EARLY_NUMBER} of servos", 0.35)
        base = _try_number(by, base, EARLY_NUMBER)
    tried = base
    by.say("trying limits of servos", 0.4)
    by, rare = rare_limits(by, base)
    has = [joint for joint in suspects if base.candidate.servos[joint].effort_limit < np.inf]
    if again := [*(joint for joint in has if joint not in loose or base.candidate.free != before), *rare]:
        by.say("trying laws of servos", 0.4)
        base = try_laws(by, base, again)
    for k, name in enumerate(by.options.additional[int(early and base is tried) :]):
        by.say(f"trying {name} of servos", 0.6 + 0.2 * k / len(by.options.additional))
        base = _try_without(by, _try_number(by, base, name), name)
    base = _like_others(by, base)
    return replace(by.shorten(base) if base.candidate.window else by.lengthen(base), laws=base.laws)


def _fit_starts(by: ServoProblem) -> ServoTrial:
    """Fit from the drives of regression, or, if better, with light rotors where these explain a joint badly.

    From a measured state a heavy rotor coasts along any smooth motion.
    """
    base = by.fit(by.start)
    badly = [j for j, rms in base.residual.items() if rms > LIMIT_ERROR_RATIO * loop_error(by.searched, j)]
    heavy = by.near(badly).intersection(joint for joint, number in by.start.free if number == "armature")
    limits = {j: by.start.servos[j].kp * LIGHT_PERIOD**2 for j in heavy}
    light = {j: by.start.servos[j].with_(armature=x) for j, x in limits.items() if x < by.start.servos[j].armature}
    if not light:
        return base
    return min(base, by.fit(by.start.changed(light)), key=lambda trial: sum(map(np.log, trial.residual.values())))


def _like_others(by: ServoProblem, base: ServoTrial) -> ServoTrial:
    """Fit joints again that are fitted far worse than another one alike by name, from its law and numbers."""
    start, again = base.candidate, list[str]()
    for members in similar_joints(tuple(base.residual)):
        best = min(members, key=lambda joint: base.residual[joint])
        like = [number for one, number in base.candidate.free if one == best]
        for joint in (one for one in members if base.residual[one] > RETRY_RATIO * base.residual[best]):
            own = {number for one, number in base.candidate.free if one == joint}
            numbers = {name: getattr(start.servos[best], name) for name in {*own, *like} - {UNSHARED}}
            law = by.assumptions.laws.get(joint, start.servos[best].law)
            servo = replace(start.servos[joint], law=law).with_(**numbers)
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


def _try_number(by: ServoProblem, base: ServoTrial, name: str) -> ServoTrial:
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
    kept = supported(by.searched, base, new, improved(base, new, promising), joints)
    if not kept:
        return base
    if kept != promising:
        near = by.near(kept)
        new = by.score(by.fit(start.only(near).changed({}, [(joint, name) for joint in kept]), LATER_STEPS), near)
    return base.with_joints(new)


def _try_without(by: ServoProblem, base: ServoTrial, name: str) -> ServoTrial:
    """Give a free number up where the training data are fitted as well without it, by now that others are free."""
    start, neutral = base.candidate, getattr(Servo(), name)
    joints = [joint for joint, number in start.free if number == name]
    if not joints:
        return base
    plain = start.changed({joint: start.servos[joint].with_(**{name: neutral}) for joint in joints})
    plain = replace(plain, free=tuple(one for one in start.free if one[1] != name))
    new = by.fit(plain.only(by.near(joints)), LATER_STEPS)
    return base if worth(new, base, joints) else base.with_joints(new)
