"""Models that are compared, by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..model import Model, ModelSource, as_model


def named_models(
    models: ModelSource | Sequence[ModelSource] | Mapping[str, ModelSource], verb: str
) -> dict[str, Model]:
    """Models by the names that are given, else by those of their robots, numbered where they are equal.

    Raises:
        OptionError: something else than a model was given to the verb.
        RobotError: invalid file.
    """
    if isinstance(models, Mapping):
        return {name: as_model(model, verb) for name, model in models.items()}
    named: dict[str, Model] = {}
    for each in models if isinstance(models, list | tuple) else [models]:
        model = as_model(each, verb)
        same = sum(other.robot.name == model.robot.name for other in named.values())
        named[f"{model.robot.name} ({same + 1})" if same else model.robot.name] = model
    return named
