"""Friction models beside each other: errors, evidence, and the numbers of each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ....errors import decimals
from ....parameters import Array
from ..layout import figure, thousandths, with_interval
from ..sections import Block, Cells, Legend, Section

if TYPE_CHECKING:
    from ....servo.identify import ServoIdentification, ServoNumber, ServoRollOut

MODELS = (
    "Each model takes the place of the friction of the drives and is fitted to the same windows of the training rows. "
    "The log Bayes factor is that of these rows over the first model; the probability allows for their differences. "
    "M1 to M6: Duclusaud et al., arXiv 2410.08650; PACE: Bjelonic et al., 2025."
)
UNITS = {"s": "ms", "1": ""}  # as `number_cell` writes them


def models_section(result: ServoIdentification, *, pages: bool = False) -> Section:
    """One row per friction model: errors of whole recordings, evidence, time; `pages`: with the numbers of each."""
    heads = ("model", "has", "mean |error|>", "rms>", "log Bayes factor>", "probability>", "processor s>")
    rows = [
        (
            one.name,
            one.terms,
            _by_unit(result.rollout, one.mean_absolute),
            _by_unit(result.rollout, one.rms),
            f"{one.log_bayes_factor:.1f}",
            "-" if np.isnan(one.probability) else f"{one.probability:.2f}",
            f"{one.seconds:.1f}",
        )
        for one in result.friction_models
    ]
    data = "held-out data" if result.rollout.held_out else "data of the fit (none was held out)"
    section = Section(f"Friction models: errors from commands alone, {data}", (Cells(heads, rows),) if rows else ())
    return section.beside(*_model_numbers(result)) if pages else section


def _by_unit(found: ServoRollOut, errors: Array) -> str:
    """Mean error of the joints of each unit; "-" where it diverges."""
    each = {unit: errors[[u == unit for u in found.units]] for unit in dict.fromkeys(found.units)}
    means = {unit: x[~np.isnan(x)] for unit, x in each.items()}
    return ", ".join(f"{thousandths(float(np.mean(x)))} m{unit}" for unit, x in means.items() if x.size)


def _model_numbers(result: ServoIdentification) -> Iterator[Block]:
    """Numbers of each friction model by joint, those that are not identifiable last."""
    rows = [
        (
            one.name,
            joint,
            ", ".join(
                f"{_word(x.name)} {number_cell(x)} {UNITS.get(x.unit, x.unit)}".rstrip()
                for x in numbers.values()
                if x.value is not None
            ),
            ", ".join(_word(x.name) for x in numbers.values() if x.value is None),
        )
        for one in result.friction_models
        for joint, numbers in one.numbers.items()
    ]
    if rows:
        yield Cells(("model", "joint", "numbers, ± 95 %", "not identifiable"), rows)
        yield Legend(MODELS)


def _word(name: str) -> str:
    return name.replace("_", " ")


def number_cell(number: ServoNumber | None) -> str:
    """Value with the half-width of its 95 % interval, or a bound; words where it is stated. Times in ms."""
    if number is None:
        return ""
    scale = 1e3 if number.unit == "s" else 1.0
    if number.value is None:
        bounds = (("<", number.below), (">", number.above))
        return next((f"{sign} {decimals(scale * bound, 2)}" for sign, bound in bounds if bound is not None), "-")
    value = scale * number.value
    if number.at_bound:
        return f"{figure(value)} (bound)"
    if number.stated or not number.std:
        return f"{figure(value)} (stated)" if number.stated else f"({figure(value)})"
    text = " ± ".join(text for text in with_interval(value, scale * number.std) if text != "-")
    return f"{text} (with prior)" if number.prior else text
