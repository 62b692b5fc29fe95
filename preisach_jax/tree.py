"""What models are made of: dataclasses whose arrays JAX can see."""

from __future__ import annotations

import equinox as eqx


class Tree(eqx.Module):
    """An `equinox.Module` whose methods are plain ones.

    Those of a Module are trees themselves, so that they can be passed to a transformation, which
    nobody does here: made anew at every call, they took a third of a diagnosis of a short record.
    """

    __getattribute__ = object.__getattribute__
