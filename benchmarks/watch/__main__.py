"""Contacts and changes of a robot at work: `python -m benchmarks.watch [--hours 0.1] [--pushes 25] [--json FILE]`.

Models are identified from 30 s in MuJoCo; the streams are other motions there, at 1 kHz, with 17 bit encoders and 2 %
torque noise. Pushes last 0.3 s (3 to 40 N at the outer half of the links); beside the watch stands a plain momentum
observer, whose thresholds raise as many false alarms. Quiet streams are whole, or lose rows. Real robots (needs
SIGNID_DATA): see `real.py`. The last line: seven joints at 1 kHz in chunks of 16 ms on one core.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from rich.console import Console
from scipy.signal import savgol_filter

import signid
from signid.model import Model
from signid.robot import configuration
from signid.simulation.excite.families import rest_to_rest_motion
from signid.types import Array
from signid.watch import Contact, Event, LastingChange, Watcher

from ..arms import ARMS, Arm, load
from ..plants.bodies import Body
from ..plants.control import Table, draw_motion
from ..summary import command_line, frame, peak, print_targets, write_json
from .plant import Alteration, Push, record
from .real import MASS, PROMPT, Load, Stream, loads, unloaded

STOP_EVERY, STOPPING, STOPPED = 7.3, 0.06, 1.5  # [s] between stops, until the arm stands, until it moves again
LEARNT = 30.0  # [s] of the recording that gives the model
BEGIN = 25.0  # [s] of the change
REACTED = 0.3  # [s] after a push within which it counts as detected
SETTLING = 1.0  # [s] after a push in which its end may be seen again
LOST, MISSING = 0.02, 0.005  # [1] share of rows that are lost, and that lack a number
GAP_EVERY, SHORTEST, LONGEST = 1.7, 0.01, 0.2  # [s] between gaps, and their durations
JITTER = 2e-4  # [s] standard deviation of the stamps, at most twice of it
OBSERVER_GAIN = 50.0  # [1/s]
SLOPE_ROWS, SLOPE_ORDER = 17, 2  # rows and order of the polynomial whose slope is the velocity
OBSERVER_SETTLED = 3.0  # [s] after which the observer has settled
SLOW_SPEED = 0.02  # [rad/s or m/s] over which the sign of dry friction is smoothed


class Detection(NamedTuple):
    """Pushes of one stream."""

    arm: str
    pushes: int
    times: tuple[float, ...]  # [s] from the beginning of the push to the event
    links: int  # detected pushes whose furthest loaded link is that of the push
    false: int  # contacts and changes in the same stream without pushes
    seconds: float  # of that stream
    plain: int = 0  # pushes that the plain observer finds at thresholds without a false alarm
    still: int = 0  # joints that stand still


class Naming(NamedTuple):
    """One change."""

    arm: str
    change: str
    named: str  # first law that was named, "" if none
    right: bool
    after: float  # [s] from its beginning, or from its end if it grows
    error: float  # [1] of the last number named, over the true one
    contacts: int  # before it was named, and after


@cache
def learnt(name: str) -> tuple[Arm, Body, Model]:
    """Arm, its plant, and the model identified from a recording in MuJoCo."""
    arm = next(arm for arm in ARMS if arm.robot == name)
    robot = load(arm)
    body = Body(robot.document, robot.joints)
    columns = record(body, arm.drives, draw_motion(arm.centre, 1), LEARNT, (), 1)
    return arm, body, signid.identify(robot, [columns]).model


def stream(
    name: str,
    seconds: float,
    events: Sequence[Push | Alteration],
    seed: int,
    *,
    still: Sequence[int] = (),
    stops: bool = False,
) -> dict[str, Array]:
    """Columns at 1 kHz of an arm that moves at random from rest to rest.

    Joints of `still` stand; with `stops`, the arm stops abruptly now and then, wherever it is.
    """
    arm, body, model = learnt(name)
    asked = rest_to_rest_motion(model.robot, seconds, 0.01, seed)
    q, v, a = (np.array(x) for x in (asked.q, asked.v, asked.a))
    for j in still:
        q[:, j], v[:, j], a[:, j] = q[0, j], 0.0, 0.0
    motion = Table(asked.t, q, v, a)
    return record(body, arm.drives, _stopping(motion) if stops else motion, seconds, events, seed)


def _stopping(motion: Table) -> Table:
    """The motion, stopped within `STOPPING` every `STOP_EVERY` for `STOPPED`."""
    t = motion.t
    since = t % STOP_EVERY
    rate = np.interp(since, [0.0, STOPPING, STOPPED, STOPPED + 4 * STOPPING], [1.0, 0.0, 0.0, 1.0])
    phase = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(t))])
    q, v, a = motion.at(phase)
    rate, change = rate[:, None], np.gradient(rate, t)[:, None]
    return Table(t, q, v * rate, a * rate**2 + v * change)


def pushes(name: str, count: int, seed: int, still: Sequence[int] = ()) -> Detection:
    """Random pushes of 0.3 s, 3 s apart, of 3 to 40 N at the outer half of the links, or at joints that stand still."""
    _, body, model = learnt(name)
    rng, n = np.random.default_rng(seed), len(body.joints)
    planned = []
    for k in range(count):
        force = rng.standard_normal(3)
        force *= rng.uniform(3.0, 40.0) / np.linalg.norm(force)
        x, y, z = (float(f) for f in force)
        planned.append(Push(20.0 + 3.0 * k, 0.3, int(rng.integers(n // 2, n)), (x, y, z)))
    seconds = 20.0 + 3.0 * count
    pushed, calm = (stream(name, seconds, events, seed, still=still) for events in (planned, ()))
    found, false = list(signid.watch(model, pushed)), list(signid.watch(model, calm))
    return _detection(name, model, planned, found, seconds)._replace(
        plain=plain_hits(model, pushed, calm, planned),
        still=len(still),
        false=len([e for e in false if isinstance(e, Contact | LastingChange)]),
        seconds=seconds,
    )


def _detection(name: str, model: Model, planned: Sequence[Push], found: Sequence[Event], seconds: float) -> Detection:
    begun = [e for e in found if isinstance(e, Contact) and e.end is None]
    times, links, hits = list[float](), 0, 0
    for push in planned:
        own = [e for e in begun if 0 <= e.t - push.start < REACTED + SETTLING]
        hits += len(own)
        if own and own[0].t - push.start < REACTED:
            times.append(own[0].t - push.start)
            links += own[0].link == model.robot.links[push.joint]
    changes = sum(isinstance(e, LastingChange) for e in found)
    rest = seconds - (REACTED + SETTLING) * len(planned)
    return Detection(name, len(planned), tuple(times), links, len(begun) - hits + changes, rest)


def quiet(name: str, seconds: float, seed: int) -> Detection:
    """False alarms of a stream in which nothing happens; seeds choose whether rows are lost, and abrupt stops."""
    _, _, model = learnt(name)
    columns = stream(name, seconds, (), seed, stops=bool(seed // 2 % 2))
    found = list(signid.watch(model, damaged(columns, seed) if seed % 2 else columns))
    return _detection(name, model, (), found, seconds)


def changed(name: str, change: Alteration, seed: int, seconds: float = 60.0) -> Naming:
    """Whether the first change that is named is the planted one."""
    _, _, model = learnt(name)
    found = list(signid.watch(model, stream(name, seconds, [change], seed)))
    named = [e for e in found if isinstance(e, LastingChange)]
    contacts = sum(isinstance(e, Contact) and e.end is None for e in found)
    where = model.robot.joints[change.joint]
    label = f"{change.effect} of {where}: {change.size:+.3g}" + (f" over {change.ramp:g} s" if change.ramp else "")
    if not named:
        return Naming(name, label, "", False, float("nan"), float("nan"), contacts)
    first = named[0]
    same = [e for e in named if e.law == change.effect and e.joint == where]
    right = bool(same) and same[0] is first
    number = next(iter(same[-1].parameters.values())) if same else float("nan")
    return Naming(
        name, label, f"{first.law} of {first.joint}", right, first.t - BEGIN, number / change.size - 1, contacts
    )


CHANGES = (
    ("panda", Alteration(BEGIN, "payload", 6, 0.5)),
    ("panda", Alteration(BEGIN, "viscous_friction", 3, 0.5)),
    ("panda", Alteration(BEGIN, "coulomb_friction", 1, 0.5, 10.0)),
    ("panda", Alteration(BEGIN, "torque_gain", 3, 0.06)),
    ("panda", Alteration(BEGIN, "torque_offset", 4, 0.2)),
    ("panda", Alteration(BEGIN, "payload", 6, 1.5)),
    ("ur10", Alteration(BEGIN, "payload", 5, 1.0)),
    ("ur10", Alteration(BEGIN, "viscous_friction", 2, 3.0)),
    ("ur10", Alteration(BEGIN, "coulomb_friction", 3, 1.0, 10.0)),
    ("ur10", Alteration(BEGIN, "torque_gain", 1, 0.06)),
    ("ur10", Alteration(BEGIN, "torque_offset", 4, 0.8)),
    ("3r", Alteration(BEGIN, "payload", 2, 0.3)),
    ("3r", Alteration(BEGIN, "viscous_friction", 1, 0.2)),
    ("3r", Alteration(BEGIN, "coulomb_friction", 0, 0.3)),
    ("3r", Alteration(BEGIN, "torque_gain", 1, 0.06)),
)
ROBOTS = ("panda", "ur10", "3r")
CHUNK = 16  # rows
PART = 120.0  # [s] of one quiet stream
WITHIN, RATE, RIGHT, SHARE = 0.05, 1.0, 0.9, 0.1  # [s], [1/h], [1], [1] targets


def cost() -> tuple[float, float]:
    """Share of one core for the Panda, and growth of memory [MB] from the first half of the stream to its end."""
    columns = stream("panda", 60.0, (), 9)
    _, _, model = learnt("panda")
    t, n = columns["t"], len(model.robot.joints)
    q, tau = (np.column_stack([columns[f"{key}_{j + 1}"] for j in range(n)]) for key in ("q", "tau"))
    watcher, spent, sizes = Watcher(model), 0.0, list[float]()
    for start in range(0, len(t), CHUNK):
        rows = slice(start, start + CHUNK)
        begin = time.process_time()
        watcher.feed(t[rows], q[rows], tau[rows])
        spent += time.process_time() - begin
        if start in (len(t) // 2 // CHUNK * CHUNK, (len(t) - 1) // CHUNK * CHUNK):
            sizes.append(peak())
    return spent / float(t[-1]), sizes[-1] - sizes[0]


def main() -> int:
    """Run all parts; 1 if a target is missed."""
    parser = command_line("watch", __doc__)
    parser.add_argument("--hours", type=float, default=0.1)
    parser.add_argument("--pushes", type=int, default=25)
    given, console = parser.parse_args(), Console()
    detected = [pushes(name, given.pushes, 11) for name in ROBOTS]
    parts = max(1, round(given.hours * 3600 / PART))
    detected += [pushes(name, given.pushes, 12, still=(0, 1)) for name in ROBOTS[:2]]
    still = [quiet(ROBOTS[k % len(ROBOTS)], PART, 100 + k) for k in range(parts)]
    named = [changed(name, change, 31) for name, change in CHANGES]
    share, grown = cost()
    streams, put_on = (unloaded(), loads()) if "SIGNID_DATA" in os.environ else ([], [])
    _show(console, detected, still, named)
    if streams:
        _show_real(console, streams, put_on)
    console.print(f"seven joints at 1 kHz: {share:.1%} of a core, memory +{grown:.1f} MB", highlight=False)
    times = np.concatenate([one.times for one in detected])
    hours = sum(one.seconds for one in (*detected, *still)) / 3600
    false = sum(one.false for one in (*detected, *still))
    right = float(np.mean([one.right for one in named]))
    plain = sum(one.plain for one in detected)
    targets = [
        (f"{len(times)} pushes, at least {plain}, those of the plain observer", len(times) >= plain),
        (f"median detection {np.median(times) * 1e3:.0f} ms, at most {WITHIN * 1e3:.0f}", np.median(times) <= WITHIN),
        (f"{false} false alarms in {hours:.2f} h, at most {RATE:g} per hour", false <= max(RATE * hours, 0)),
        (f"named first {right:.0%}, at least {RIGHT:.0%}", right >= RIGHT),
        (f"{share:.1%} of a core, at most {SHARE:.0%}", share <= SHARE),
    ]
    if streams:
        hours, false = sum(one.seconds for one in streams) / 3600, sum(one.false for one in streams)
        found = float(np.mean([one.named for one in put_on]))
        targets += [
            (f"real robots: {false} false alarms in {hours:.2f} h, at most {RATE:g} per hour", false <= RATE * hours),
            (f"real loads named first within {PROMPT:g} s: {found:.0%}, at least {RIGHT:.0%}", found >= RIGHT),
        ]
    met = print_targets(console, targets)
    rows = {"pushes": detected, "quiet": still, "changes": named, "real": streams, "loads": put_on}
    content = {key: [one._asdict() for one in value] for key, value in rows.items()}
    write_json(given.json, {**content, "share": share})
    return 0 if met else 1


def _show(console: Console, detected: list[Detection], still: list[Detection], named: list[Naming]) -> None:
    names = ("arm", "still", "detected", "plain", "median [ms]", "90 % [ms]", "right link", "false", "of [s]")
    table = frame("pushes; plain: found by the plain observer", names)
    for one in detected:
        middle, most = np.percentile(one.times, [50, 90]) * 1e3 if one.times else (np.nan, np.nan)
        hit = f"{len(one.times)} of {one.pushes}"
        numbers = (one.plain, f"{middle:.0f}", f"{most:.0f}", one.links, one.false, f"{one.seconds:.0f}")
        table.add_row(one.arm, str(one.still), hit, *map(str, numbers))
    console.print(table)
    table = frame("quiet", ("arm", "streams", "hours", "false alarms"))
    for name in dict.fromkeys(one.arm for one in still):
        own = [one for one in still if one.arm == name]
        hours, false = sum(one.seconds for one in own) / 3600, sum(one.false for one in own)
        table.add_row(name, str(len(own)), f"{hours:.2f}", str(false))
    console.print(table)
    table = frame("changes", ("arm", "change", "named first", "after [s]", "error", "contacts"), left=3)
    for row in named:
        mark = row.named if not row.right else "right"
        table.add_row(row.arm, row.change, mark or "-", f"{row.after:.1f}", f"{row.error:+.1%}", str(row.contacts))
    console.print(table)


def _show_real(console: Console, streams: list[Stream], put_on: list[Load]) -> None:
    for robot in dict.fromkeys(one.robot for one in streams):
        own = [one for one in streams if one.robot == robot]
        seconds, false = sum(one.seconds for one in own), sum(one.false for one in own)
        console.print(f"{robot}: {false} false alarms in {len(own)} streams of {seconds:.0f} s", highlight=False)
    named = [one for one in put_on if one.named]
    middle = {key: float(np.median([getattr(one, key) for one in named])) for key in ("after", "width", "narrower")}
    first, second = (
        float(np.sqrt(np.mean([(x - MASS) ** 2 for x in masses])))
        for masses in ([one.mass for one in named], [one.corrected for one in named])
    )
    inside = sum(abs(one.corrected - MASS) <= one.narrower for one in named)
    console.print(
        f"load of {MASS} kg: {len(named)} of {len(put_on)} named first within {PROMPT:g} s, after "
        f"{middle['after']:.1f} s (median), ± {middle['width']:.2f} kg (rms error {first:.2f}), then "
        f"± {middle['narrower']:.2f} kg (rms error {second:.2f}, {inside} of {len(named)} intervals hold it); "
        f"{sum(one.later for one in put_on)} contacts later",
        highlight=False,
    )


def damaged(columns: dict[str, Array], seed: int) -> dict[str, Array]:
    """Columns with 2 % of the rows lost, gaps up to 0.2 s (every second one holds the last row), NaN and jitter."""
    rng, t = np.random.default_rng(seed), columns["t"]
    keep, from_row = rng.random(len(t)) > LOST, np.arange(len(t))
    for k, begin in enumerate(np.arange(GAP_EVERY, t[-1], GAP_EVERY)):
        gap = (t > begin) & (t < begin + rng.uniform(SHORTEST, LONGEST))
        if k % 2:
            from_row[gap] = np.flatnonzero(gap)[0]
        else:
            keep &= ~gap
    out = {key: x[from_row][keep].copy() for key, x in columns.items() if key != "t"}
    names = list(out)
    for row in np.flatnonzero(rng.random(int(keep.sum())) < MISSING).tolist():
        out[names[int(rng.integers(len(names)))]][row] = np.nan
    jitter = np.clip(JITTER * rng.standard_normal(len(t)), -2 * JITTER, 2 * JITTER)
    return {"t": (t + jitter)[keep], **out}


def external_torque(model: Model, t: Array, q: Array, tau: Array) -> Array:
    """External torque (N, n) [N.m or N] of rows at times t (N,) [s] with positions and torques (N, n).

    The momentum observer as textbooks have it (De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IEEE/RSJ IROS 2006):
    r = K (momentum - integral of the known torque and r), with friction by the model.
    """
    step = float(np.median(np.diff(t)))
    v = savgol_filter(q, SLOPE_ROWS, SLOPE_ORDER, deriv=1, delta=step, axis=0)
    bodies = model.bodies()
    rotors, bodies.armature = bodies.armature.copy(), np.zeros(bodies.nv)
    data, drive = bodies.createData(), model.robot.drive
    friction = np.zeros_like(q)
    for law in model.laws:
        j, known = law.joints[0], law.parameters
        if law.effect.name == "viscous_friction":
            friction[:, j] += known["coefficient"] * v[:, j]
        elif law.effect.name == "coulomb_friction":
            friction[:, j] += known["level"] * np.tanh(v[:, j] / SLOW_SPEED)
        elif law.effect.name == "torque_offset":
            friction[:, j] += known["offset"]
    r, total, begun = np.zeros_like(q), np.zeros(q.shape[1]), np.zeros(q.shape[1])
    for k, (position, rate) in enumerate(zip(configuration(model.robot, q), v @ drive.T, strict=True)):
        mass = pin.crba(bodies, data, position)
        mass = np.triu(mass) + np.triu(mass, 1).T + np.diag(rotors)
        momentum = drive.T @ mass @ rate
        coriolis = pin.computeCoriolisMatrix(bodies, data, position, rate)
        known = drive.T @ (coriolis.T @ rate - pin.computeGeneralizedGravity(bodies, data, position))
        if k == 0:
            begun = momentum
        total += step * (tau[k] - friction[k] + known + r[k - 1])
        r[k] = OBSERVER_GAIN * (momentum - begun - total)
    return -r


def plain_hits(model: Model, pushed: dict[str, Array], calm: dict[str, Array], planned: Sequence[Push]) -> int:
    """Pushes in which the residual exceeds the largest one of the same stream without pushes.

    These thresholds are the lowest ones without a false alarm; no watch can know them in advance.
    """
    n = len(model.robot.joints)

    def of(columns: dict[str, Array]) -> Array:
        q, tau = (np.column_stack([columns[f"{key}_{j + 1}"] for j in range(n)]) for key in ("q", "tau"))
        return external_torque(model, columns["t"], q, tau)

    late = calm["t"] > OBSERVER_SETTLED
    over = (np.abs(of(pushed)) > np.abs(of(calm)[late]).max(axis=0)).any(axis=1)
    t = pushed["t"]
    return sum(bool(over[(t >= one.start) & (t < one.start + one.duration)].any()) for one in planned)


if __name__ == "__main__":
    raise SystemExit(main())
