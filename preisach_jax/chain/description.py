"""What is in a chain, and where."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import equinox as eqx

from preisach_jax.effects.base import (
    AddedEffect,
    Effect,
    HysteresisEffect,
    InputEffect,
    OutputEffect,
    Parameter,
    SensorEffect,
    WeightEffect,
)
from preisach_jax.errors import EffectError
from preisach_jax.operator.plane import Plane
from preisach_jax.tree import Tree

Kind = TypeVar("Kind", bound=Effect)

PLACES = (InputEffect, HysteresisEffect, WeightEffect, OutputEffect, AddedEffect, SensorEffect)

MIDDLE = "middle"
"""Initial memory of which all that the first sample leaves open is halfway: that of a prediction
whose past is not known."""

EffectValues = Mapping[str, Mapping[str, float]]
"""Values of the nonlinear parameters, by effect and by name."""


def model_name(effects: Iterable[str]) -> str:
    """A model by its effects."""
    return " + ".join(("Preisach model", *effects))


class Chain(Tree):
    """What is in a model and in which order, without its numbers.

    Arguments:
        signed: whether there are weights of both signs, as in butterfly loops.
    """

    plane: Plane
    effects: tuple[Effect, ...] = ()
    hysteron: str = eqx.field(static=True, default="ramp")
    polarity: int = eqx.field(static=True, default=1)
    signed: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        names = [effect.name for effect in self.effects]
        if len(set(names)) < len(names):
            raise EffectError(f"the effects {names} have a name twice; give each its own")
        for effect in self.effects:
            if not isinstance(effect, PLACES):
                raise EffectError(
                    f"the effect {effect.name!r} is a {type(effect).__name__}: derive it from "
                    + ", ".join(place.__name__ for place in PLACES)
                )

    def at(self, place: type[Kind]) -> list[Kind]:
        """The effects of one place, in order."""
        return [effect for effect in self.effects if isinstance(effect, place)]

    def effect(self, name: str) -> Effect:
        """The effect of that name."""
        return next(effect for effect in self.effects if effect.name == name)

    @property
    def in_order(self) -> list[Effect]:
        """All effects in the order in which a signal passes them."""
        return [effect for place in PLACES for effect in self.at(place)]

    @property
    def coefficients(self) -> list[tuple[str, Parameter]]:
        """Effect and coefficient of each column behind the offset, in order."""
        beside = [*self.at(AddedEffect), *self.at(WeightEffect), *self.at(OutputEffect)]
        linear = [*beside, *self.at(SensorEffect)]
        return [(effect.name, each) for effect in linear for each in effect.coefficients()]

    @property
    def sensor_coefficients(self) -> int:
        """How many of the coefficients, the last ones, belong to the sensor."""
        return sum(len(effect.coefficients()) for effect in self.at(SensorEffect))

    @property
    def feeds_back(self) -> bool:
        """Whether an effect makes the input of the hysterons depend on their output."""
        return any(effect.feeds_back for effect in self.at(HysteresisEffect))

    @property
    def widens(self) -> bool:
        """Whether an effect moves thresholds outward."""
        return any(effect.widens for effect in self.at(HysteresisEffect))

    @property
    def by_path(self) -> bool:
        """Whether slow effects go with the path of the input, as nothing tells the time."""
        return any(getattr(effect, "by_path", False) for effect in self.effects)

    @property
    def mechanics(self) -> Any:
        """The effect that puts the hysteresis inside mechanics; None where there is none."""
        return next((effect for effect in self.effects if effect.inside_mechanics), None)

    @property
    def size_text(self) -> str:
        """How many numbers the hysteresis has, in words."""
        one_state = self.mechanics is not None and self.mechanics.has_one_state
        placed = "" if self.plane.own_thresholds is None else " where the output moves"
        return "Bouc-Wen law" if one_state else f"{self.plane.levels} levels{placed}"

    @property
    def converters(self) -> list[Effect]:
        """The effects that work in steps: those of the input, then those of the sensor."""
        rounding = [effect for effect in self.at(InputEffect) if effect.rounds]
        return [*rounding, *(effect for effect in self.at(SensorEffect) if effect.converts)]

    @property
    def unrounded(self) -> Chain:
        """The chain without converters of the input, whose steps have no rate and no slope."""
        kept = (e for e in self.effects if not (isinstance(e, InputEffect) and e.rounds))
        return self.with_effects(tuple(kept))

    def with_effects(self, effects: tuple[Effect, ...]) -> Chain:
        """The same plane and hysterons with other effects."""
        return replace(self, effects=effects)
