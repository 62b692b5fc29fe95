"""A model as a system of python-control."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from preisach_jax.cores import on_processor
from preisach_jax.errors import InputError
from preisach_jax.export.description import Description, describe
from preisach_jax.export.stepper import State, advance, start
from preisach_jax.model import Model

if TYPE_CHECKING:
    from control import NonlinearIOSystem


def to_control(
    model: Model, rate_hz: float | None = None, without: Sequence[str] = (), name: str | None = None
) -> NonlinearIOSystem:
    """A model as a discrete `control.NonlinearIOSystem`.

    Its inputs are the input and the auxiliary columns of the record, by their names there, its
    output the output, and its states those of the hysterons (the lowest and the highest possible
    one, as the start is unknown) and of the effects. Initial states of zero are those before the
    first sample: from them the output is that of `Model.predict` for a record that continues none.
    """
    try:
        import control
    except ImportError:
        raise InputError(
            "python-control is not installed: pip install 'preisach_jax[control]'"
        ) from None
    described = describe(model, rate_hz, without)
    with on_processor():
        layout = start(described)
        step: Any = jax.jit(partial(advance, described))

    def taken_in(x: Any, u: Any) -> tuple[State, Any]:
        with on_processor():
            return step(_unpacked(layout, x), np.atleast_1d(np.asarray(u, dtype=float)))

    def output(t: float, x: Any, u: Any, params: Any) -> float:
        del t, params
        return float(taken_in(x, u)[1])

    def update(t: float, x: Any, u: Any, params: Any) -> np.ndarray:
        del t, params
        return _packed(layout, taken_in(x, u)[0])

    return control.NonlinearIOSystem(
        update,
        output,
        inputs=[column.name for column in (described.input, *described.aux)],
        outputs=[described.output.name],
        states=_labels(layout),
        dt=described.step_s,
        name=name or _name(described),
    )


def _name(described: Description) -> str:
    plain = "".join(c if c.isalnum() else "_" for c in described.record)
    return plain or "preisach"


def _labels(layout: State) -> list[str]:
    return [f"{name}[{k}]" for name, values in layout.items() for k in range(len(values))]


def _packed(layout: State, state: State) -> np.ndarray:
    """States as one vector that is zero before the first sample."""
    return np.concatenate([np.asarray(state[name]) - before for name, before in layout.items()])


def _unpacked(layout: State, vector: np.ndarray) -> State:
    ends = np.cumsum([len(before) for before in layout.values()])
    parts = np.split(np.asarray(vector, dtype=float), ends[:-1])
    return {name: part + before for part, (name, before) in zip(parts, layout.items(), strict=True)}
