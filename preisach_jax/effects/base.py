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

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from preisach_jax.effects.arrays import arrays_in
from preisach_jax.effects.low_pass import low_pass_step as low_pass_step  # noqa: PLC0414
from preisach_jax.effects.parameter import Parameter, declared_by
from preisach_jax.effects.places import Place
from preisach_jax.effects.tracing import told_as_its_own
from preisach_jax.errors import InputError, unfinished

Values = Mapping[str, Any]
"""Values of an effect's parameters by name."""

RATES, CYCLES = "rates", "cycles"
"""What a record may have to hold to tell an effect from the density (`Effect.needs`)."""

_nothing = partial(np.zeros, 0)


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
    cycle_s: float = 0.0

    @property
    def speeds(self) -> np.ndarray:
        """(move,) absolute rates of the input between measured samples of one run."""
        speeds = np.abs(np.diff(self.input) / np.diff(self.time))
        return np.delete(speeds, np.array(self.starts, dtype=int) - 1) if self.starts else speeds


class Signals(eqx.Module):
    """What drives a model: time (s), input, and auxiliary columns, each `(time,)`."""

    time: Float[Array, " time"]
    input: Float[Array, " time"]
    aux: dict[str, Float[Array, " time"]]


class Effect(eqx.Module):
    """What all effects share: the texts of the library, and the parameters.

    Class attributes:
        name: name in models, reports and on the command line.
        in_words: what a verdict calls it, so that a mechanic understands it; that of an effect of a
            column has `{}` for the column.
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
            more than once.
        goes_with_speed: whether what it does goes with the speed of the input, so that
            a second effect of that kind must do much more to be named.
        limited_by_residual: whether its limit is where it would make the whole residual, since it
            is searched from values that the residual speaks for.
        special: whether it stands behind a common effect that a record cannot tell from it.
        found_in_residual: whether its search starts from what the residual shows, so that it begins
            anew with all rows of a record.
        needs_clock: whether it goes with times or rates, so that a record that only counts samples
            says nothing of it.
        of_time_alone: whether what it does depends on nothing but the time. It is then known before
            the input is, and differs from one record to the next where several are fitted together.

    Fields that are declared by `parameter` hold the values of the parameters where the effect acts
    (see `at`).  The other fields say how it is bound to a record.  Floats, and tuples of them, are
    traced where the effect acts, so that code compiled for one record serves others; to branch on
    them there, or to print them, declare them static (`eqx.field(static=True)`).
    """

    name: ClassVar[str] = ""
    in_words: ClassVar[str] = ""
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
    form_pays: ClassVar[float] = 0.5

    def __hash__(self) -> int:
        return hash(self.name)  # arrays, which an effect may hold, have none

    @property
    def lawless(self) -> bool:
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

    def probe(self, times: float = 1.0) -> Self:
        """This effect with the one start, so many times over, to find a limit by the residual."""
        del times
        return self

    def settings(self) -> dict[str, Any]:
        """The fields of this effect, for the model file; of those with arrays, these as lists."""
        plain = {own.name: getattr(self, own.name) for own in fields(self) if not declared_by(own)}
        held = {name: arrays_in(value) for name, value in plain.items()}
        return plain | {n: [each.tolist() for each in own] for n, own in held.items() if own}


class _Stepped(Effect):
    """An effect on one scalar signal, written as `init` and `step`."""

    def init(self, first: Array) -> Any:
        """State before the first sample, whose value is `first` (the machine was at rest)."""
        raise unfinished(self, "init(self, first)")

    def step(self, state: Any, value: Array, dt: Array) -> tuple[Any, Array]:
        """New state and output after `dt` seconds, at whose end the signal is `value`."""
        raise unfinished(self, "step(self, state, value, dt)")

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
        dt = jnp.diff(time, prepend=time[:1])

        def advance(state: Any, sample: tuple[Array, Array]) -> tuple[Any, Array]:
            return self.step(state, *sample)

        with told_as_its_own(self):
            return jax.lax.scan(advance, self.init(signal[0]), (signal, dt))[1]


class InputEffect(_Stepped):
    """An effect between the recorded input and the hysteresis; what it rounds has no rate."""

    place: ClassVar[Place] = Place.INPUT
    rounds: ClassVar[bool] = False


class HysteresisEffect(Effect):
    """An effect inside the hysteresis: it moves thresholds with speed, or feeds the output back."""

    place: ClassVar[Place] = Place.HYSTERESIS
    feeds_back: ClassVar[bool] = False
    """Whether `fed_back` makes the input of the hysterons depend on their output."""

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


class OutputEffect(_Stepped):
    """An effect between the hysteresis and the recorded output, linear in its signal.

    `init` takes the machine to be at rest before the first sample.  An effect of a long memory says
    in `free_response` what another past leaves, as columns of free coefficients.
    """

    place: ClassVar[Place] = Place.OUTPUT

    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficient of each column of the free response; by default none."""
        return ()

    def free_response(self, signals: Signals) -> Float[Array, "time column"]:
        """What states that were not at rest at the first sample add, `(time, columns)`."""
        return jnp.zeros((*signals.time.shape, 0), signals.time.dtype)

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


class AddedEffect(Effect):
    """An effect that adds to the output, linear in its coefficients.

    Class attributes:
        beside_the_loop: whether effects of the weights scale what it adds, as they scale the loop,
            and its input is that of the loop, behind the effects of the input.
    """

    place: ClassVar[Place] = Place.ADDED
    beside_the_loop: ClassVar[bool] = False

    def coefficients(self) -> tuple[Parameter, ...]:
        """The coefficient of each column, found by linear least squares."""
        raise unfinished(self, "coefficients(self)")

    def columns(self, signals: Signals) -> Float[Array, "time column"]:
        """What is added for a coefficient of one, `(time, columns)`."""
        raise unfinished(self, "columns(self, signals)")


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

    def converted(self, reading: Float[Array, " time"]) -> Float[Array, " time"]:
        """The reading in the steps of a converter; by default as it is.

        What the steps depend on is not fitted: it keeps the start that `bound_to` gives it.
        """
        return reading
