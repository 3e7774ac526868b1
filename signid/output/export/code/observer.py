"""Momentum observer of a model as C99: residual torque, thresholds that it learns, and contacts, row by row."""

from __future__ import annotations

import re

import numpy as np

from ....model import Model
from ....watch import intake, observer, quiet, watcher
from ..bodies import summed
from .dynamics import Bodies, Expressions, carried_wrench, cross, directed_laws, placement, rotor_torque, tree_of
from .graph import Graph
from .program import Function, Program, vector

OBSERVER_TERMS = ("momentum of the bodies", "momentum", "C' v - g", "laws", "dry friction", "viscous friction")
ROW_WEIGHT = 0.01  # [1] share of a row in the running means of the sampling period and of the noise of the velocity


def observer_terms(model: Model) -> Program:
    """Terms (6, n) of the observer at one row, as a function of motion and state.

    q, v: (n,) [rad or m, and their derivative]; a, load: (n,) acceleration and torque of the bodies, through the filter
    of the observer [rad/s2 or m/s2, N.m or N]; slow: (n,) speed below which the direction of friction is uncertain.
    """
    graph, tree, n = Graph(), tree_of(model), len(model.robot.joints)
    arguments = ("q", "v", "a", "load", "slow")
    q, v, a, load, slow = (vector(graph, key, n) for key in arguments)
    momentum, force = momentum_and_force(graph, tree, q, v)
    graph.section = "momentum with rotors"
    whole = momentum + rotor_torque(tree, v)
    laws, reversing = directed_laws(graph, model, {"q": q, "v": v, "a": a, "load": load}, slow)
    graph.section = "viscous friction"
    viscous = np.abs(np.nan_to_num(summed(model, "viscous_friction")) * v)
    outputs = np.concatenate([momentum, whole, force, laws, reversing, viscous])
    function = Function("observer_terms", arguments, "terms", tuple(map(graph.scalar, outputs)), "")
    return Program(graph, (function,))


def observer_code(model: Model, name: str) -> tuple[str, str, str]:
    """Header, source and lines of the test program, from the constants of the watch; the terms are apart."""
    n = len(model.robot.joints)
    misfit = np.zeros(n) if model.misfit is None else np.nan_to_num(model.misfit.size)
    numbers = {
        **{key: repr(float(x)) for key, x in _OBSERVER_CONSTANTS.items()},
        "NAME": name,
        "COUNT": str(n),
        "TERMS": str(len(OBSERVER_TERMS) * n),
        "MISFIT": f"{{{', '.join(repr(float(x)) for x in misfit)}}}",
    }
    pattern = re.compile(rf"\b({'|'.join(numbers)})(?=\b|_)")
    header, source, test = (pattern.sub(lambda match: numbers[match[0]], text) for text in (_HEADER, _SOURCE, _TEST))
    return header, source, test


_OBSERVER_CONSTANTS = {
    "GAIN": observer.OBSERVER_GAIN,
    "RINGING": observer.RINGING_TIME,
    "HALF": intake.VELOCITY_HALF_WINDOW,
    "MORE": observer.CREEP_FRICTION_GROWTH,
    "BELOW": observer.CREEP_SPEED_RATIO,
    "SIGMAS": quiet.THRESHOLD_RATIO,
    "PEAK": quiet.PEAK_THRESHOLD_RATIO,
    "SHARE": quiet.FRICTION_ERROR_SHARE,
    "STRANGE": quiet.UNMOVED_ERROR_SHARE,
    "LITTLE": quiet.TORQUE_CHANGE_SHARE,
    "LEAVE": watcher.CONTACT_END_RATIO,
    "LASTING": watcher.CONTACT_START_TIME,
    "APART": watcher.CONTACT_END_TIME,
    "LOST": intake.RESET_GAP_STEPS,
    "LEAST": intake.MIN_RESET_GAP,
    "JITTER": watcher.SLOW_SPEED_DEVIATIONS / np.sqrt(6.0),  # of the second difference of a velocity
    "SLOWEST": watcher.SLOW_SPEED_RATIO,
    "STILL": watcher.MIN_SLOW_SPEED,
    "MOVED": quiet.MIN_MOTION_TIME,
    "WARM": watcher.SPEED_SHARE,
    "PATIENCE": watcher.MAX_QUIET_RATIO,
    "RECENT": ROW_WEIGHT,
}
_HEADER = """

/* Momentum observer: residual torque, its thresholds, and contacts, one row at a time, without allocation.
   The residual is measured minus predicted torque through a first-order filter of GAIN per s, as in `signid watch`:
   what the drives give beyond the model, which is minus the torque of external forces on the joints. Call
   NAME_observer_reset once, NAME_observer_learn before motion without contacts, and NAME_observer_step at every row.
   The struct is the whole state; a copy of it keeps what was learned. */
typedef struct {
    double residual[COUNT]; /* measured minus predicted torque [N.m or N] */
    double excess[COUNT]; /* size of the part of the residual that unknown friction cannot explain [N.m or N] */
    double threshold[COUNT]; /* of the excess [N.m or N]; HUGE_VAL until it has learned */
    int contact[COUNT]; /* 1: the excess is above its threshold (for LASTING s; until APART s below LEAVE of it) */
    int learning; /* 0: no; 1: speeds; 2: sizes of the residual; 3: its largest values in units of these sizes */
    double noise[COUNT], delay[COUNT]; /* size of the residual [N.m or N]; of torque that is early or late [s] */
    double share[COUNT], factor[COUNT]; /* error of friction [1]; threshold over size [1], 0 until it has learned */
    double slow[COUNT]; /* speed below which the direction of friction is uncertain [rad/s or m/s] */
    double low[COUNT], high[COUNT]; /* residual that unknown friction can leave [N.m or N] */
    double friction[COUNT], predicted[COUNT], load[COUNT], rate[COUNT], peak[COUNT]; /* filters from here on */
    double speed[COUNT], acceleration[COUNT], above[COUNT], below[COUNT];
    double last[TERMS], last_v[COUNT], last_tau[COUNT], period, waited;
    int begun;
    double change[COUNT], jitter[COUNT], floor[COUNT], moved[COUNT], sums[5][COUNT], quiet, moving, total;
} NAME_observer;

/* Forget everything. */
void NAME_observer_reset(NAME_observer *o);

/* Empty the filters of the residual and keep what was learned, as after a gap between rows. */
void NAME_observer_restart(NAME_observer *o);

/* Learn thresholds from the next rows with quiet s of motion without contacts (20 s, the usual motions): WARM of that
   time gives speeds, then half of it the sizes of the residual (noise, torque that is late, friction), then half of it
   the largest residual in units of these sizes. Threshold: the larger of SIGMAS sizes and PEAK of the largest; multiply
   factor for others. It ends after PATIENCE times as long in any case; joints that did not move take delay and factor
   of the others. */
void NAME_observer_learn(NAME_observer *o, double quiet);

/* Next row: positions q, velocities v [per s] and torques tau of one instant, dt [s] after the row before (also if
   that was skipped). Noise of v sets the thresholds: use the slope of a line through the last 16 ms of positions, or
   what the drive gives. A row with a number that is not finite is skipped (not with -ffast-math); after more than LEAST
   s and LOST usual steps without rows the filters are emptied. */
void NAME_observer_step(
    NAME_observer *o, const double q[COUNT], const double v[COUNT], const double tau[COUNT], double dt);
"""
_SOURCE = """
static const double NAME_misfit[COUNT] = MISFIT; /* rms that the model left when it was identified [N.m or N] */

void NAME_observer_reset(NAME_observer *o)
{
    static const NAME_observer none;
    *o = none;
    for (int j = 0; j < COUNT; j++) {
        o->threshold[j] = HUGE_VAL;
        o->slow[j] = STILL;
    }
}

void NAME_observer_restart(NAME_observer *o)
{
    for (int j = 0; j < COUNT; j++) {
        o->residual[j] = o->excess[j] = o->low[j] = o->high[j] = o->rate[j] = 0.0;
        o->acceleration[j] = o->change[j] = o->above[j] = o->below[j] = 0.0;
        o->contact[j] = 0;
    }
    o->begun = 0;
}

void NAME_observer_learn(NAME_observer *o, double quiet)
{
    for (int j = 0; j < COUNT; j++) {
        o->floor[j] = o->moved[j] = o->factor[j] = 0.0;
        o->threshold[j] = HUGE_VAL;
        o->contact[j] = 0;
        for (int k = 0; k < 5; k++) {
            o->sums[k][j] = 0.0;
        }
    }
    o->quiet = quiet;
    o->moving = o->total = 0.0;
    o->learning = 1;
}

static double NAME_observer_size(const NAME_observer *o, int j)
{
    const double late = o->delay[j] * o->peak[j], friction = o->share[j] * o->friction[j];
    return sqrt(o->noise[j] * o->noise[j] + late * late + friction * friction);
}

/* One row of speeds, of sums for the sizes, or of the largest ratio. */
static void NAME_observer_count(NAME_observer *o, int j, double v, double dt)
{
    const double power = o->excess[j] * o->excess[j], rate = o->peak[j] * o->peak[j];
    const double friction = (o->moved[j] < MOVED ? STRANGE : SHARE) * o->friction[j], step = o->period;
    double *sums[5];
    for (int k = 0; k < 5; k++) {
        sums[k] = &o->sums[k][j];
    }
    o->moved[j] += fabs(v) > o->slow[j] ? dt : 0.0;
    if (o->learning == 1) {
        o->slow[j] = fmax(o->slow[j], fmax(SLOWEST * fabs(v), JITTER * sqrt(o->jitter[j])));
        *sums[0] += 1.0;
        *sums[1] += power;
    } else if (o->learning == 2) {
        const double least = NAME_misfit[j] * NAME_misfit[j] + friction * friction + step * step * rate;
        const double size = fmax(least, o->floor[j]), weight = 1.0 / (size * size);
        *sums[0] += weight;
        *sums[1] += weight * rate;
        *sums[2] += weight * rate * rate;
        *sums[3] += weight * power;
        *sums[4] += weight * power * rate;
    } else {
        o->factor[j] = fmax(o->factor[j], o->excess[j] / fmax(NAME_observer_size(o, j), 1e-12));
    }
}

/* Noise and delay of a joint: weighted least squares of squared residuals, neither negative. */
static void NAME_observer_fit(NAME_observer *o, int j)
{
    const double one = o->sums[0][j], rate = o->sums[1][j], rate2 = o->sums[2][j];
    const double power = o->sums[3][j], both = o->sums[4][j], det = one * rate2 - rate * rate;
    double noise = power / one, delay = 0.0;
    if (det > 1e-12 * one * rate2) {
        noise = (power * rate2 - both * rate) / det;
        delay = (both * one - power * rate) / det;
        if (noise < 0.0) {
            noise = 0.0;
            delay = both / rate2;
        } else if (delay < 0.0) {
            noise = power / one;
            delay = 0.0;
        }
    }
    o->noise[j] = sqrt(noise + NAME_misfit[j] * NAME_misfit[j]);
    o->delay[j] = sqrt(delay + o->period * o->period);
    o->share[j] = o->moved[j] < MOVED ? STRANGE : SHARE;
}

/* End of a part of the learning: what its rows give. */
static void NAME_observer_conclude(NAME_observer *o)
{
    double delay = 0.0, factor = 0.0;
    for (int j = 0; j < COUNT; j++) {
        if (o->learning == 1) {
            o->floor[j] = LITTLE * o->sums[1][j] / o->sums[0][j] + 1e-24;
            for (int k = 0; k < 5; k++) {
                o->sums[k][j] = 0.0;
            }
        } else if (o->learning == 2) {
            NAME_observer_fit(o, j);
        }
        delay = o->moved[j] < MOVED ? delay : fmax(delay, o->delay[j]);
        factor = o->moved[j] < MOVED ? factor : fmax(factor, o->factor[j]);
    }
    for (int j = 0; j < COUNT && o->learning > 1; j++) {
        if (o->moved[j] < MOVED) {
            o->delay[j] = fmax(delay, o->delay[j]);
            o->factor[j] = fmax(factor, o->factor[j]);
        }
        if (o->learning == 3) {
            o->factor[j] = fmax(SIGMAS, PEAK * o->factor[j]);
        }
    }
    o->moving = o->total = 0.0;
    o->learning = (o->learning + 1) % 4;
}

static void NAME_observer_gather(NAME_observer *o, const double v[COUNT], double dt)
{
    const double part = (o->learning == 1 ? WARM : 0.5) * o->quiet;
    int moving = 0;
    for (int j = 0; j < COUNT; j++) {
        moving |= fabs(v[j]) > o->slow[j];
        NAME_observer_count(o, j, v[j], dt);
    }
    o->moving += moving ? dt : 0.0;
    o->total += dt;
    if (o->moving >= part || o->total >= PATIENCE * part) {
        NAME_observer_conclude(o);
    }
}

static void NAME_observer_decide(NAME_observer *o, int j, double dt)
{
    const double threshold = o->learning || o->factor[j] <= 0.0 ? HUGE_VAL : o->factor[j] * NAME_observer_size(o, j);
    o->threshold[j] = threshold;
    o->above[j] = o->excess[j] > threshold ? o->above[j] + dt : 0.0;
    o->below[j] = o->excess[j] < LEAVE * threshold ? o->below[j] + dt : 0.0;
    if (o->above[j] >= LASTING) {
        o->contact[j] = 1;
    } else if (o->below[j] >= APART) {
        o->contact[j] = 0;
    }
}

/* One joint: filters of the residual, of what unknown friction leaves, and of the rate of the predicted torque.
   torque: mean of two rows; keep: what remains of the filters of GAIN, LASTING and RINGING after a step. */
static void NAME_observer_filter(
    NAME_observer *o, int j, const double terms[TERMS], double v, double torque, double dt, const double keep[3])
{
    const double *last = o->last, dry = terms[4 * COUNT + j], new = 1.0 - keep[0], before = o->predicted[j];
    const double force = 0.5 * (terms[2 * COUNT + j] + last[2 * COUNT + j]);
    const double laws = 0.5 * (terms[3 * COUNT + j] + last[3 * COUNT + j]);
    const double bodies = (terms[j] - last[j]) / dt - force;
    const double predicted = (terms[COUNT + j] - last[COUNT + j]) / dt - force + laws;
    const double side = fmax(fmin(v / o->slow[j], 1.0), -1.0), acceleration = GAIN * (v - o->speed[j]);
    const int near = fabs(v) < o->slow[j] + HALF * fabs(acceleration);
    const double more = MORE * fabs(side) * exp(-fabs(v) / (BELOW * o->slow[j])); /* of a joint that creeps */
    o->acceleration[j] = acceleration;
    o->speed[j] += new * (v - o->speed[j]);
    o->residual[j] += new * (torque - predicted - o->residual[j]);
    o->load[j] += new * (bodies - o->load[j]);
    o->predicted[j] += new * (predicted - before);
    o->rate[j] += (1.0 - keep[1]) * ((o->predicted[j] - before) / dt - o->rate[j]);
    o->peak[j] = fmax(fabs(o->rate[j]), keep[2] * o->peak[j]);
    o->low[j] += new * (((near ? -1.0 - side : 0.0) - more) * dry - o->low[j]);
    o->high[j] += new * (((near ? 1.0 - side : 0.0) + more) * dry - o->high[j]);
    o->friction[j] += new * (terms[5 * COUNT + j] + dry - o->friction[j]);
    o->excess[j] = fmax(fmax(o->residual[j] - o->high[j], o->low[j] - o->residual[j]), 0.0);
}

void NAME_observer_step(
    NAME_observer *o, const double q[COUNT], const double v[COUNT], const double tau[COUNT], double dt)
{
    double terms[TERMS];
    if (!(dt > 0.0 && isfinite(dt))) {
        return;
    }
    o->waited += dt;
    for (int j = 0; j < COUNT; j++) {
        if (!isfinite(q[j]) || !isfinite(v[j]) || !isfinite(tau[j])) {
            return;
        }
    }
    dt = o->waited;
    o->waited = 0.0;
    if (o->begun && dt > fmax(LEAST, LOST * o->period)) {
        NAME_observer_restart(o);
    }
    o->period = o->period > 0.0 ? o->period + RECENT * (fmin(dt, 2.0 * o->period) - o->period) : dt;
    NAME_observer_terms(q, v, o->acceleration, o->load, o->slow, terms);
    const double keep[3] = {exp(-GAIN * dt), exp(-dt / LASTING), exp(-dt / RINGING)};
    for (int j = 0; j < COUNT; j++) {
        const double change = v[j] - o->last_v[j], turn = change - o->change[j];
        if (o->begun) {
            o->jitter[j] += RECENT * (turn * turn - o->jitter[j]);
            o->change[j] = change;
            NAME_observer_filter(o, j, terms, v[j], 0.5 * (tau[j] + o->last_tau[j]), dt, keep);
            NAME_observer_decide(o, j, dt);
        } else { /* as without acceleration */
            o->speed[j] = v[j];
            o->load[j] = -terms[2 * COUNT + j];
            o->predicted[j] = terms[3 * COUNT + j] - terms[2 * COUNT + j];
            o->friction[j] = terms[4 * COUNT + j] + terms[5 * COUNT + j];
        }
        o->last_v[j] = v[j];
        o->last_tau[j] = tau[j];
    }
    for (int k = 0; k < TERMS; k++) {
        o->last[k] = terms[k];
    }
    if (o->begun && o->learning) {
        NAME_observer_gather(o, v, dt);
    }
    o->begun = 1;
}
"""
_TEST = """    static NAME_observer observer;
    if (!observer.begun) {
        NAME_observer_reset(&observer);
    }
    NAME_inverse_dynamics(q, v, a, out);
    NAME_observer_step(&observer, q, v, out, 0.001);
    show("observer", observer.residual, COUNT);
"""


def momentum_and_force(graph: Graph, tree: Bodies, q: Expressions, v: Expressions) -> tuple[Expressions, Expressions]:
    """Momentum M v (n,) [N.m.s or N.s] and C' v - g (n,) [N.m or N] of the bodies, without rotors.

    q, v: (n,) expressions [rad or m, and their derivative]. C' v is the derivative of the kinetic energy with respect
    to position: the momentum of all bodies after a joint times the cross product of the velocity of its body and its
    axis. Source of such a recursion: De Luca, Ferrajoli, IEEE ICRA 2009.
    """
    none = np.array([graph.constant(0.0)] * 3)
    angles, speeds = tree.drive @ q + tree.rest, tree.drive @ v
    places, motions = [], list[tuple[Expressions, Expressions, Expressions]]()
    for k, body in enumerate(tree.bodies):
        graph.section = f"{body.name}: motion"
        turn, offset = placement(graph, body, graph.scalar(angles[k]))
        w0, speed0, weight0 = motions[body.parent] if body.parent >= 0 else (none, none, none - tree.gravity)
        w, speed, along = turn.T @ w0, turn.T @ (speed0 + cross(w0, offset)), body.axis * speeds[k]
        w, speed = (w, speed + along) if body.prismatic else (w + along, speed)
        places.append((turn, offset))
        motions.append((w, speed, turn.T @ weight0))
    momenta = list[tuple[Expressions, Expressions]]()
    for body, (w, speed, _) in zip(tree.bodies, motions, strict=True):
        graph.section = f"{body.name}: momentum"
        linear = body.mass * speed + cross(w, body.moment)
        momenta.append((linear, cross(body.moment, speed) + body.inertia @ w))
    masses, moments = [body.mass for body in tree.bodies], [body.moment for body in tree.bodies]
    momentum, force = np.full((2, len(tree.bodies)), graph.constant(0.0))
    for k in reversed(range(len(tree.bodies))):
        body, (linear, angular), (w, speed, weight) = tree.bodies[k], momenta[k], motions[k]
        graph.section = f"{body.name}: momentum and torque with the bodies after it"
        momentum[k] = body.axis @ (linear if body.prismatic else angular)
        turned = cross(linear, w) if body.prismatic else cross(angular, w) + cross(linear, speed)
        heavy = masses[k] * weight if body.prismatic else cross(moments[k], weight)
        force[k] = body.axis @ (turned - heavy)
        if (parent := body.parent) >= 0:
            turn, offset = places[k]
            above, carried = momenta[parent], carried_wrench(turn, offset, linear, angular)
            momenta[parent] = above[0] + carried[0], above[1] + carried[1]
            masses[parent] = masses[parent] + masses[k]
            moments[parent] = moments[parent] + turn @ moments[k] + masses[k] * offset
    momentum, force = tree.drive.T @ momentum, tree.drive.T @ force
    return np.array([graph.scalar(x) for x in momentum]), np.array([graph.scalar(x) for x in force])
