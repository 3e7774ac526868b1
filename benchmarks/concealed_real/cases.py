"""The cases of a set, of which each knows what it changed and what should be said."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from signid.model import Model
from signid.rigid import carried

from .band import Array, rms
from .case import Case, Truth
from .changes import Change, Scene, plus, recorded, scaled_law, shifted, swapped, tilted, times, with_body, without
from .payloads import carrying, load_of
from .sets import columns_of

LAWS = ("coulomb_friction", "viscous_friction", "armature", "torque_offset")
SMALLER, HEAVIER = 3.0, 1.2
TILT = float(np.radians(3.0))
LATE, GAIN, OFFSET = 3, 1.15, 0.05  # samples, 1, rad or m


def every(scene: Scene) -> Iterator[Case]:
    """All of them, the plainest first.

    Args:
        scene: of the set.
    """
    yield from laws(scene)
    yield from bodies(scene)
    yield from recordings(scene)


def laws(scene: Scene) -> Iterator[Case]:
    """One law less, of each kind, at the joint where it matters most; and one of the wrong size."""
    size = _torque(scene)
    for effect in LAWS:
        own = {law.joints[0]: law for law in scene.model.laws if law.effect.name == effect}
        if not own:
            continue
        changed = scene.ratios(without(scene.model, effect)) * rms(scene.rest) / size
        joint = max(own, key=lambda j: changed[j])
        numbers = dict(own[joint].parameters)
        truth = Truth((effect,), (joint,), numbers, numbers)
        yield _case(scene, "law removed", f"no {effect}", joint, without(scene.model, effect, joint), truth)
        if effect == "coulomb_friction":
            smaller = scaled_law(scene.model, effect, joint, 1 / SMALLER)
            lacking = {key: (1 - 1 / SMALLER) * x for key, x in numbers.items()}
            truth = Truth((effect,), (joint,), lacking, numbers)
            yield _case(scene, "law of wrong size", f"{effect} / {SMALLER:g}", joint, smaller, truth)


def bodies(scene: Scene) -> Iterator[Case]:
    """A payload more and less, a link too heavy, and a base that leans."""
    model, last = scene.model, len(scene.model.robot.joints) - 1
    load, body = load_of(model), carried(model.robot, last)
    truth = Truth(("payload",), (last,), {"mass": -float(load[0])}, last=True)
    yield _case(scene, "payload gone", f"{-load[0]:.3g} kg", last, with_body(model, body, load), truth)
    truth = Truth(("payload",), (last,), {"mass": float(load[0])}, last=True)
    before, b, c = (carrying(x, model, y, scene.band) for x, y in ((scene.b, None), (scene.b, load), (scene.c, load)))
    yield Case("payload carried", _at(scene, f"{load[0]:.3g} kg", last), model, b, c, truth, before=before)
    middle = range(last + 1) if last < 2 else range(1, last)
    own = {j: model.inertials[carried(model.robot, j)] for j in middle}
    heavier = {j: with_body(model, carried(model.robot, j), (HEAVIER - 1) * x) for j, x in own.items()}
    joint = _largest(scene, heavier)
    truth = Truth(("link_inertia",), (joint,), {"mass": (1 - HEAVIER) * float(own[joint][0])}, last=joint == last)
    yield _case(scene, "link +20 %", "its link", joint, heavier[joint], truth)
    leaning = {axis: tilted(model, *(TILT * (k == axis) for k in (0, 1))) for axis in (0, 1)}
    axis = _largest(scene, leaning)
    truth = Truth(("base_tilt",), None, {key: -TILT * (k == axis) for k, key in enumerate("xy")})
    yield _case(scene, "base tilted", f"3 degrees about {'xy'[axis]}", None, leaning[axis], truth)


def recordings(scene: Scene) -> Iterator[Case]:
    """Torque late and early, a gain, a zero, a sign and an exchange, in both recordings alike."""
    n, step = len(scene.model.robot.joints), float(np.median(np.diff(columns_of(scene.b)["t"])))
    for samples, word in ((LATE, "late"), (-LATE, "early")):
        truth = Truth(("time_delay",), tuple(range(n)), {"delay": samples * step}, fault=word)
        what = f"{LATE} samples, {1e3 * LATE * step:.3g} ms"
        yield _logged(scene, f"torque {word}", what, None, truth, lambda x, k=samples: shifted(x, k))  # type: ignore[misc]
    order = np.argsort(-_torque(scene) / rms(scene.rest)).tolist()  # the joint whose torque is clearest first
    first, middle = order[0], order[n // 2]
    truth = Truth(("torque_gain",), (first,), {"error": GAIN - 1}, fault="gain")
    yield _logged(scene, "torque gain", f"x {GAIN:g}", first, truth, lambda x: times(x, first, GAIN))
    trials = [recorded(scene.b, scene.model, lambda x, j=j: plus(x, j, OFFSET)) for j in range(n)]  # type: ignore[misc]
    zero = int(np.argmax([np.max(scene.ratios(scene.model, b)) for b in trials]))
    truth = Truth(("encoder_offset",), (zero,), {"offset": OFFSET})
    yield _logged(scene, "encoder offset", f"+{OFFSET:g}", zero, truth, lambda x: plus(x, zero, OFFSET))
    truth = Truth(("torque_sign",), (middle,), fault="sign")
    yield _logged(scene, "torque sign", "negated", middle, truth, lambda x: times(x, middle, -1.0))
    if n > 1:
        pair = (middle, middle + 1) if middle + 1 < n else (middle - 1, middle)
        truth = Truth(("channel_swap",), pair, fault="swap")
        yield _logged(scene, "channels swapped", "with the next", pair[0], truth, lambda x: swapped(x, pair))


def _case(scene: Scene, kind: str, what: str, joint: int | None, model: Model, truth: Truth) -> Case:
    return Case(kind, _at(scene, what, joint), model, scene.b, scene.c, truth)


def _logged(scene: Scene, kind: str, what: str, joint: int | None, truth: Truth, change: Change) -> Case:
    b, c = (recorded(one, scene.model, change) for one in (scene.b, scene.c))
    return Case(kind, _at(scene, what, joint), scene.model, b, c, truth)


def _at(scene: Scene, what: str, joint: int | None) -> str:
    return what if joint is None else f"{what} at {scene.model.robot.joints[joint]}"


def _largest(scene: Scene, changed: Mapping[int, Model]) -> int:
    """The key of the model that leaves most."""
    sizes = {key: float(np.max(scene.ratios(model))) for key, model in changed.items()}
    return max(sizes, key=lambda key: sizes[key])


def _torque(scene: Scene) -> Array:
    """(n,) [N.m or N] rms of the recorded torque."""
    return rms(columns_of(scene.b)["tau"])
