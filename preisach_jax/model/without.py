"""A model without some of its effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from preisach_jax.errors import InputError, require_list
from preisach_jax.model.core import Model


def without_effects(model: Model, without: Sequence[str]) -> Model:
    """The model without some of its effects."""
    require_list("without", without)
    names = [effect.name for effect in model.effects]
    for name in without:
        if name not in names:
            have = ", ".join(names) or "none"
            raise InputError(
                f"there is no effect {name!r} to leave out; give one of the model: {have}"
            )
    if not without:
        return model
    linear = zip(model.chain.coefficients, model.coefficients.added.tolist(), strict=True)
    added = [value for (name, _), value in linear if name not in without]
    effects = tuple(effect for effect in model.effects if effect.name not in without)
    return replace(
        model,
        chain=model.chain.with_effects(effects),
        coefficients=replace(model.coefficients, added=np.array(added)),
        band=None,
    )
