"""The contract of an effect: what it is, where it acts, and how it is computed.

The signal chain of every model is::

    u ─► input ─► hysteresis ─► weight ─► output ─► (+) ─► sensor ─► z
        effects     effects    effects   effects     │     effects
                                      added effects ─┘

An effect is one small class.  It derives from the class of its *place*, declares its parameters
as fields, and says what it does to a signal.  Effects of the input and of the output are written
as `init` and `step` for one scalar signal; the base class runs them over time with the actual
time step, and the model maps them over regressors.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import partial
from typing import Any, ClassVar, Self, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.errors import JAXTypeError, TracerBoolConversionError
from jaxtyping import Array, Float

from preisach_jax.effects.linear import StateSpace, response
from preisach_jax.effects.low_pass import low_pass_step as low_pass_step  # noqa: PLC0414
from preisach_jax.effects.parameter import Parameter, declared_by, time_constant
from preisach_jax.errors import EffectError, InputError, unfinished
from preisach_jax.tree import Tree

Values = Mapping[str, Any]
"""Values of an effect's parameters by name."""

RATES, CYCLES, HEIGHTS = "rates", "cycles", "heights"
"""What a record may have to hold to tell an effect from the density (`Effect.needs`)."""

_nothing = partial(np.zeros, 0)


class Place(StrEnum):
    """Where an effect acts, in the order in which a signal passes the chain.

    Effects of the sensor (`SensorEffect`) are effects of the output that act last of all.

    Example:
        >>> Place.WEIGHTS, Place("added").acts_on
        (<Place.WEIGHTS: 'weights'>, 'the sum, beside the hysteresis')
    """

    INPUT = "input"
    HYSTERESIS = "hysteresis"
    WEIGHTS = "weights"
    OUTPUT = "output"
    ADDED = "added"

    @property
    def acts_on(self) -> str:
        """What an effect of this place acts on, in words."""
        return _ACTS_ON[self]


_ACTS_ON = {
    Place.INPUT: "the input, before the hysteresis",
    Place.HYSTERESIS: "the thresholds of the hysterons",
    Place.WEIGHTS: "the weights of the hysterons",
    Place.OUTPUT: "the output of the hysteresis",
    Place.ADDED: "the sum, beside the hysteresis",
}


@dataclass(frozen=True)
class Survey:
    """What an effect may know of a record before it is fitted.

    Arguments:
        duration_s: time from the first sample to the last, in s.
        step_s: median time step, in s.
        time, input, output: (sample,) the measured samples: s, and units of the record.
        residual: (sample,) what the model without the effect leaves, in output units; empty where
            there is no model yet.
        aux: (sample,) auxiliary columns by name, in their units.
        starts: samples at which another run starts, behind the first one.
        path: (sample,) path of the input, see `Signals.path`, where samples are only counted.
        cycle_s: time between two passages of a place of the input in one direction, in s, in the
            median; zero where it is not known.
    """

    duration_s: float
    step_s: float
    time: np.ndarray = field(default_factory=_nothing, compare=False, repr=False)
    input: np.ndarray = field(default_factory=_nothing, compare=False, repr=False)
    output: np.ndarray = field(default_factory=_nothing, compare=False, repr=False)
    residual: np.ndarray = field(default_factory=_nothing, compare=False, repr=False)
    aux: Mapping[str, np.ndarray] = field(
        default_factory=dict[str, np.ndarray], compare=False, repr=False
    )
    starts: tuple[int, ...] = ()
    path: np.ndarray = field(default_factory=_nothing, compare=False, repr=False)
    cycle_s: float = 0.0

    @property
    def speeds(self) -> np.ndarray:
        """(move,) absolute rates of the input between measured samples of one run."""
        speeds = np.abs(np.diff(self.input) / np.diff(self.time))
        return np.delete(speeds, np.array(self.starts, dtype=int) - 1) if self.starts else speeds


class Signals(Tree):
    """What drives a model: time (s), input, and auxiliary columns, each `(time,)`.

    `gone` is the path of the input where these samples do not hold all of it.
    """

    time: Float[Array, " time"]
    input: Float[Array, " time"]
    aux: dict[str, Float[Array, " time"]]
    gone: Float[Array, " time"] | None = eqx.field(default=None, kw_only=True)

    @property
    def path(self) -> Float[Array, " time"]:
        r"""Path of the input before each sample, \(\sum_{j<k} |u_j - u_{j-1}|\), `(time,)`.

        The move to the sample itself is not in it, so that it is known before the input is.
        """
        if self.gone is not None:
            return self.gone
        moves = jnp.abs(jnp.diff(self.input, prepend=self.input[:1]))
        return jnp.cumsum(moves) - moves


class Effect(Tree):
    """What all effects share: the texts of the library, and the parameters.

    Class attributes:
        name: name in models, reports and on the command line.
        in_words: what a verdict calls it, so that a mechanic understands it; that of an effect of a
            column has `{}` for the column.
        rank: where it stands in lists and in the order of trials; of one rank, by its name.
        place: where it acts.
        physics: one paragraph on what happens in the machine.
        source: where that can be read.
        signature: what the residual of a model without it looks like.
        confused_with: names of the effects that look alike.
        experiment: what to record to tell them apart.
        form_pays: share of a simpler form's held-out mean square that another form of the effect
            (see `variants`) must not leave.
        on_request: whether a diagnosis tries it only where it is asked for by name.
        of_field: which signal of a magnet is the field, `"input"` or `"output"`, where a diagnosis
            tries it all the same.
        needs: what a record must hold to tell the effect from the density of hysterons: `RATES`,
            places that are passed at more than one rate, or rests; `CYCLES`, places that are passed
            more than once; `HEIGHTS`, loops that turn inside of the range.
        goes_with_speed: whether what it does goes with the speed of the input, so that
            a second effect of that kind must do much more to be named.
        limited_by_residual: whether its limit is where it would make the whole residual, since it
            is searched from values that the residual speaks for.
        special: whether it stands behind a common effect that a record cannot tell from it.
        found_in_residual: whether its search starts from what the residual shows, so that it begins
            anew with all rows of a record.
        needs_clock: whether it goes with times or rates, so that a record that only counts samples
            says nothing of it.
        inside_mechanics: whether the output drives the hysteresis, inside a motion: such an effect
            is fitted alone, by the simulated motion (`preisach_jax.mechanics`).
        line: name of the parameter that is the frequency of a line in its output, if it is one; its
            coefficients are the cosine and the sine of each multiple.
        smoothed_by: name of the parameter that is the time over which it takes the speed of the
            input, if it goes with that.
        of_time_alone: whether what it does depends on nothing but the time. It is then known before
            the input is, and differs from one record to the next where several are fitted together.

    Fields that are declared by `parameter` hold the values of the parameters where the effect acts
    (see `at`).  The other fields say how it is bound to a record.  Floats, and tuples of them, are
    traced where the effect acts, so that code compiled for one record serves others; to branch on
    them there, or to print them, declare them static (`eqx.field(static=True)`).
    """

    name: ClassVar[str] = ""
    in_words: ClassVar[str] = ""
    rank: ClassVar[int] = 1000
    place: ClassVar[Place]
    physics: ClassVar[str] = ""
    source: ClassVar[str] = ""
    signature: ClassVar[str] = ""
    confused_with: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = ()
    on_request: ClassVar[bool] = False
    of_field: ClassVar[str] = ""
    goes_with_speed: ClassVar[bool] = False
    limited_by_residual: ClassVar[bool] = False
    special: ClassVar[bool] = False
    found_in_residual: ClassVar[bool] = False
    needs_clock: ClassVar[bool] = True
    of_time_alone: ClassVar[bool] = False
    inside_mechanics: ClassVar[bool] = False
    line: ClassVar[str] = ""
    smoothed_by: ClassVar[str] = ""
    form_pays: ClassVar[float] = 0.5

    def __hash__(self) -> int:
        return hash(self.name)  # arrays, which an effect may hold, have none

    @property
    def nonparametric(self) -> bool:
        """Whether this form follows no law, and so takes up a part of anything that is like it."""
        return False

    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that the search must find (those that enter the model nonlinearly)."""
        found: list[Parameter] = []
        for own in fields(self):
            if declared := declared_by(own):
                found += declared.parameters(self, own.name)
        return tuple(found)

    def at(self, values: Values) -> Self:
        """This effect with values of its parameters.

        Arguments:
            values: the values by the parameters' names; a parameter that is missing keeps its own.

        Returns:
            The effect, ready to act on signals.

        Raises:
            InputError: if it has no parameter of such a name.

        Example:
            >>> from preisach_jax.effects.resonance import Resonance
            >>> Resonance().at({"f_hz": 200.0, "zeta": 0.02}).f_hz
            200.0
        """
        found: dict[str, Any] = {}
        known: list[str] = []
        for own in fields(self):
            if declared := declared_by(own):
                names = declared.names(self, own.name)
                known += names
                given = [values[name] for name in names if name in values]
                if given and declared.count is not None:
                    found[own.name] = tuple(given)
                elif given:
                    found[own.name] = given[0]
        if strange := set(values) - set(known):
            raise InputError(
                f"the effect {self.name!r} has no parameter {min(strange)!r}; give values of "
                f"{', '.join(known) or 'none'}"
            )
        return replace(self, **found) if found else self

    def bound_to(self, survey: Survey) -> Effect:
        """This effect with its scales and starts set to a record's; by default unchanged."""
        del survey
        return self

    def variants(self, survey: Survey) -> tuple[Effect, ...]:
        """Forms of the effect to try on a record, the simplest first; by default `bound_to`'s."""
        return (self.bound_to(survey),)

    def enlarged(
        self, survey: Survey, values: Values
    ) -> tuple[Self, tuple[dict[str, float], ...]] | None:
        """This effect with one term more, and values to start from; by default None, it has none.

        Of several starts those are refined that would explain most in the size that suits them:
        the output is taken to be linear in what of the term is searched on a linear scale.

        Arguments:
            survey: the record, with the residual of a model that has this effect.
            values: the values of its parameters in that model.
        """
        del survey, values
        return None

    def reduced(self, values: Values) -> Sequence[tuple[Self, dict[str, float]]]:
        """This effect with each of its terms left out in turn, and what the others have."""
        del values
        return ()

    def sampled(self, step_s: float, amounts: tuple[float, ...]) -> dict[str, Any] | None:
        """Numbers of this effect in generated C, where `NAME.c.j2` beside its module has its code.

        Arguments:
            step_s: sample interval, in s.
            amounts: its linear coefficients.
        """
        del step_s, amounts
        return None

    def probe(self, times: float = 1.0) -> Self:
        """This effect with the one start, so many times over, to find a limit by the residual."""
        del times
        return self

    def settings(self) -> dict[str, Any]:
        """The fields of this effect, for the model file; of those with arrays, these as lists."""
        plain = {own.name: getattr(self, own.name) for own in fields(self) if not declared_by(own)}
        held = {name: arrays_in(value) for name, value in plain.items()}
        return plain | {n: [each.tolist() for each in own] for n, own in held.items() if own}


@contextmanager
def mistakes_named(effect: Any) -> Generator[None]:
    """Turn JAX's errors of a value that is traced into one line that names the place."""
    try:
        yield
    except JAXTypeError as error:
        kind = cast(type[Any], type(effect))
        frames = traceback.walk_tb(error.__traceback__)
        own = [(f, line) for f, line in frames if f.f_globals.get("__name__") == kind.__module__]
        stack = traceback.StackSummary.extract(iter(own[-1:]))
        at = f" (line {stack[0].lineno}: {stack[0].line})" if stack else ""
        what, remedy = (
            ("branches on", "write jnp.where(condition, a, b) in place of if, and, or, min and max")
            if isinstance(error, TracerBoolConversionError)
            else ("makes a Python number of", "use jax.numpy in place of numpy, math and float()")
        )
        raise EffectError(
            f"the effect {effect.name!r} {what} a value that is not known while JAX traces "
            f"{kind.__name__}{at}: {remedy}"
        ) from error


class Stepped(Effect):
    """An effect on one scalar signal: a `state_space` if it is linear, else `init` and `step`."""

    @property
    def is_linear(self) -> bool:
        """Whether a state space says all about it."""
        own = type(self)
        return own.state_space is not Stepped.state_space and own.step is Stepped.step

    @property
    def is_stepped(self) -> bool:
        """Whether it can be followed from one sample to the next."""
        return self.is_linear or type(self).step is not Stepped.step

    def state_space(self, dt: Array) -> StateSpace:
        """The effect over a step of `dt` seconds, where it is linear."""
        raise unfinished(self, "state_space(self, dt)")

    def init(self, first: Array) -> Any:
        """State before the first sample, whose value is `first` (the machine was at rest)."""
        if not self.is_linear:
            raise unfinished(self, "init(self, first)")
        return jnp.zeros_like(self.state_space(jnp.ones_like(first)).b), first

    def step(self, state: Any, value: Array, dt: Array) -> tuple[Any, Array]:
        """New state and output after `dt` seconds, at whose end the signal is `value`."""
        if not self.is_linear:
            raise unfinished(self, "step(self, state, value, dt)")
        law, (states, last) = self.state_space(dt), state
        states = law.moved(states, value - last)
        return (states, value), law.output(states, value)

    def apply(
        self, signal: Float[Array, " time"], time: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        """The signal after the effect, sample by sample with the actual time step.

        Arguments:
            signal: the signal, `(time,)`.
            time: time in s, `(time,)`.

        Returns:
            The signal behind the effect, `(time,)`.
        """

        def advance(state: Any, sample: tuple[Array, Array]) -> tuple[Any, Array]:
            return self.step(state, *sample)

        with mistakes_named(self):
            if self.is_linear:
                return response(self.state_space, signal, time)
            dt = jnp.diff(time, prepend=time[:1])
            return jax.lax.scan(advance, self.init(signal[0]), (signal, dt))[1]


class InputEffect(Stepped):
    """An effect between the recorded input and the hysteresis; what it rounds has no rate."""

    place: ClassVar[Place] = Place.INPUT
    rounds: ClassVar[bool] = False
    limits_rate: ClassVar[bool] = False
    """Whether all that it does is to keep the rate below `greatest_rate`."""

    @property
    def greatest_rate(self) -> Any:
        """Greatest rate that passes it, in input units per s; a search keeps to it."""
        return math.inf


class HysteresisEffect(Effect):
    """An effect inside the hysteresis: it moves thresholds with speed, or feeds the output back."""

    place: ClassVar[Place] = Place.HYSTERESIS
    feeds_back: ClassVar[bool] = False
    """Whether `fed_back` makes the input of the hysterons depend on their output."""

    @property
    def widens(self) -> bool:
        """Whether it moves thresholds outward."""
        return type(self).widening is not HysteresisEffect.widening

    @property
    def widens_reversible(self) -> bool:
        """Whether hysterons on the diagonal α = β, which are reversible, get a width as well."""
        return False

    def widening(
        self, path: Float[Array, " time"], time: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        """By how much thresholds move outward, α + δ and β - δ, `(time,)`, in input units."""
        del time
        return jnp.zeros_like(path)

    def fed_back(
        self,
        path: Float[Array, " time"],
        output: Float[Array, " time"],
        time: Float[Array, " time"],
    ) -> Float[Array, " time"]:
        """What the hysterons see of an input and of their own output at the same instants.

        It may depend on the input at the same sample, and on the output at that and the one before,
        of which the model finds the output that agrees with itself. Of an actuator whose output
        falls as the input rises, it is the negative output.
        """
        del output, time
        return path


class OutputEffect(Stepped):
    """An effect between the hysteresis and the recorded output, linear in its signal.

    `init` takes the machine to be at rest before the first sample.  An effect of a long memory says
    in `free_response` what another past leaves, as columns of free coefficients.
    """

    place: ClassVar[Place] = Place.OUTPUT
    is_delay: ClassVar[bool] = False
    """Whether it delays its signal by `late_s` and does nothing else."""

    @property
    def late_s(self) -> Any:
        """Time by which it delays its signal, in s."""
        return 0.0

    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficient of each column of the free response; by default none."""
        return ()

    def free_response(self, signals: Signals) -> Float[Array, "time column"]:
        """What states that were not at rest at the first sample add, `(time, columns)`."""
        return jnp.zeros((*signals.time.shape, 0), signals.time.dtype)

    @property
    def bounds_its_past(self) -> bool:
        """Whether it says how far its past can have moved the output."""
        return type(self).past_bound is not OutputEffect.past_bound

    def past_bound(self, signals: Signals, furthest: float) -> Float[Array, " time"]:
        """How far a past that is not known can move the output from that of a machine at rest.

        Arguments:
            signals: what drives the record.
            furthest: greatest distance of the effect's input, at any time before the record, from
                its first value.

        Returns:
            (time,) bound, in the output's unit; by default zero.
        """
        del furthest
        return jnp.zeros_like(signals.time)


class WeightEffect(Effect):
    """An effect that scales all weights as time goes by.

    What scales them may move the output as well, with coefficients of its own.
    """

    place: ClassVar[Place] = Place.WEIGHTS

    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficient of each of the `columns`, found by least squares; by default none."""
        return ()

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        """What is added for a coefficient of one, `(time, columns)`; by default nothing."""
        return jnp.zeros((*signals.time.shape, 0), signals.time.dtype)

    def factor(self, signals: Signals) -> Float[Array, " time"]:
        """Factor on all weights at each sample, `(time,)`."""
        raise unfinished(self, "factor(self, signals)")


class AddedEffect(Stepped):
    """An effect that adds to the output, linear in its coefficients.

    It is written as `columns`; or sample by sample, as a `state_space` or as `init` and `step` of
    its `driver`, whose output is then the columns at that sample.

    Class attributes:
        beside_the_loop: whether effects of the weights scale what it adds, as they scale the loop,
            and its input is that of the loop, behind the effects of the input.
    """

    place: ClassVar[Place] = Place.ADDED
    beside_the_loop: ClassVar[bool] = False

    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficient of each column, found by linear least squares."""
        raise unfinished(self, "coefficients(self)")

    def driver(self, signals: Signals) -> Float[Array, " time"]:
        """The signal that `step` takes in, `(time,)`: by default the input."""
        return signals.input

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        """What is added for a coefficient of one, `(time, columns)`."""
        if not self.is_stepped:
            raise unfinished(self, "columns(self, signals)")
        return self.apply(self.driver(signals), signals.time)


class SensorEffect(Effect):
    """What the sensor makes of the output: a memoryless map, and the steps of its converter.

    The map is written backwards, which keeps it linear in its coefficients c: the reading z
    solves z - Σ c_k φ_k(z) = y, with y the output of the rest of the model.
    """

    place: ClassVar[Place] = Place.OUTPUT

    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficient of each φ, found by linear least squares; by default none."""
        return ()

    def columns(self, reading: Float[Array, " time"]) -> Float[Array, "time column"]:
        """The functions φ_k of a reading, `(time, columns)`, smooth; by default none."""
        return jnp.zeros((*reading.shape, 0), reading.dtype)

    @property
    def converts(self) -> bool:
        """Whether the reading has the steps of a converter."""
        return type(self).converted is not SensorEffect.converted

    @property
    def resolution(self) -> Any:
        """Step of the converter, in output units; readings may differ by so much and be alike."""
        return 0.0

    def converted(self, reading: Float[Array, " time"]) -> Float[Array, " time"]:
        """The reading in the steps of a converter; by default as it is.

        What the steps depend on is not fitted: it keeps the start that `bound_to` gives it.
        """
        return reading


def column_lag() -> Any:
    """The lag behind an auxiliary column, as a parameter of an effect."""
    return time_constant(
        "lag; at its lower bound the action is immediate",
        margins=(1, 2),
        per_decade=1.0,
        open_ended="both",
    )


class OfColumn(Effect):
    """An effect of an auxiliary column, with a first-order lag.

    Class attributes:
        prefix: what stands before the column's name in that of the effect.

    Arguments:
        unit: unit of the column.
    """

    prefix: ClassVar[str] = ""

    column: str = eqx.field(static=True, default="COL")
    unit: str = eqx.field(static=True, default="1")
    tau_low_s: float = 1e-3
    tau_high_s: float = 1.0

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return f"{self.prefix}:{self.column}"

    def bound_to(self, survey: Survey) -> Self:
        return replace(self, tau_low_s=survey.step_s / 10, tau_high_s=survey.duration_s / 5)

    def driver(self, signals: Signals) -> Float[Array, " time"]:
        """The column, `(time,)`."""
        return signals.aux[self.column]


def auxiliary_columns(effects: Iterable[Effect]) -> list[str]:
    """Names of the auxiliary columns that some effects act through, each once, in their order."""
    return list(dict.fromkeys(e.column for e in effects if isinstance(e, OfColumn)))


Kind = TypeVar("Kind", bound=Effect)


def is_floating(leaf: Any) -> bool:
    """Whether a leaf of an effect is a floating array, of JAX or NumPy."""
    kind: Any = getattr(leaf, "dtype", None)
    return isinstance(leaf, jax.Array | np.ndarray) and jnp.issubdtype(kind, jnp.floating)


def arrays_in(value: Any) -> list[Any]:
    """The floating arrays of a field of an effect, in the order of its tree."""
    return [leaf for leaf in jax.tree.leaves(value) if is_floating(leaf)]


def with_settings(pattern: Kind, settings: dict[str, Any], place: str) -> Kind:
    """An effect of a pattern's kind with the settings of a file."""
    held = [name for name in settings if arrays_in(getattr(pattern, name))]
    if not held:
        return type(pattern)(**settings)
    own = pattern.settings()
    others = {k: v for k, v in settings.items() if k not in held and v != own[k]}

    def fields(effect: Kind) -> list[Any]:
        return [getattr(effect, name) for name in held]

    return eqx.tree_at(
        fields,
        replace(pattern, **others) if others else pattern,
        [_filled(getattr(pattern, name), settings[name], f"{place}.{name}") for name in held],
    )


def _filled(value: Any, arrays: Any, place: str) -> Any:
    """A field of an effect with the arrays of a file, nested lists, in place of its own."""
    expected: list[tuple[int, ...]] = [leaf.shape for leaf in arrays_in(value)]
    try:
        given = [np.asarray(each, dtype=float) for each in arrays]
        shapes = [each.shape for each in given]
    except (TypeError, ValueError):
        given, shapes = [], None
    if shapes != expected or not all(np.isfinite(each).all() for each in given):
        found = "no lists of finite numbers" if shapes is None else f"arrays of {shapes}"
        raise InputError(
            f"{place} holds {found:.80}, and the effect that was passed arrays of {expected}: pass "
            "one of the size that was saved"
        )
    others = iter(given)

    def filled(leaf: Any) -> Any:
        return next(others) if is_floating(leaf) else leaf

    return jax.tree.map(filled, value)
