"""A model with its numbers, and what it predicts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from preisach_jax.chain import (
    Chain,
    Coefficients,
    behind_hysteresis,
    drive,
    first_run_output,
    hysteresis_output,
    response,
    signals_of,
    stated_start,
)
from preisach_jax.chain.description import model_name
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import Effect, OutputEffect, Signals
from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes, write_files
from preisach_jax.hooks import HOOKS
from preisach_jax.model.band import Band, Course
from preisach_jax.model.estimates import ParameterEstimate, Prediction
from preisach_jax.model.mechanical import check_not_inside, moved
from preisach_jax.model.origin import Origin
from preisach_jax.model.requirements import check_record
from preisach_jax.model.spread import Numbers, differences, spread_of
from preisach_jax.model.unforeseen import unforeseen
from preisach_jax.model.weights import exactly_summable
from preisach_jax.operator.hysteron import position_on
from preisach_jax.operator.plane import Plane
from preisach_jax.quantity import quantity
from preisach_jax.record import AS_FITTED, Record

if TYPE_CHECKING:
    from control import NonlinearIOSystem


@dataclass(frozen=True, eq=False)
class Model:
    """An identified model.

    Attributes:
        chain: plane, effects, kind of hysteron.
        values: nonlinear parameters of the effects.
        coefficients: weights, initial memory, offset, coefficients of added effects.
        parameters: all parameters of the effects with 95 % intervals.
        visited: (cells,) whether the identification record moved the hysteron.
        columns: names of the columns: `"time"`, `"input"`, `"output"`, and a list `"aux"`.
        units: unit of each of these columns, by role or auxiliary name.
        origin: the record on which it was identified.
        rms_validation: held-out RMS error, in output units.
        noise, discretisation: their shares of it, where a diagnosis has measured them.
        band: the 95 % band, calibrated on rows that did not identify what predicts them; of models
            that were written before there was one, None.
    """

    chain: Chain
    values: Mapping[str, Mapping[str, float]]
    coefficients: Coefficients
    parameters: Mapping[str, Mapping[str, ParameterEstimate]]
    visited: np.ndarray
    columns: Mapping[str, Any]
    units: Mapping[str, str]
    origin: Origin
    rms_validation: float
    noise: float | None = None
    discretisation: float | None = None
    band: Band | None = None

    @property
    def line(self) -> str:
        """Effects, levels and error in one line."""
        error = quantity(self.rms_validation, self.units.get("output", ""), 3)
        return f"{self.name}, {self.chain.size_text}, held-out error {error} RMS"

    def __repr__(self) -> str:
        return f"<Model {self.line}>"

    def _repr_html_(self) -> str:
        return HOOKS["Model._repr_html_"](self)

    @property
    def plane(self) -> Plane:
        """The Preisach plane."""
        return self.chain.plane

    @property
    def weights(self) -> np.ndarray:
        """(cells,) weights R in output units."""
        return self.coefficients.weights

    @property
    def offset(self) -> float:
        """Output with all hysterons off, in output units."""
        return self.coefficients.offset

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, in order."""
        return self.chain.effects

    @property
    def name(self) -> str:
        """The model by its effects."""
        return model_name(effect.name for effect in self.effects)

    def with_budget(self, noise: float, discretisation: float) -> Model:
        """The same model, knowing what its error is made of."""
        return replace(self, noise=noise, discretisation=discretisation)

    def simulate(self, record: Record) -> np.ndarray:
        """Output along a record that starts as the identification record did, `(time,)`."""
        if self.chain.mechanics:
            return self.offset + moved(self.chain, self.values, self.weights, record, begins=True)
        with on_processor():
            signals = signals_of(record, self.origin.start_s)
            return np.asarray(response(self.chain, self.values, signals, self.coefficients))

    def predict(self, record: Record) -> Prediction:
        """Predict the output of a record from its input (and auxiliary columns) alone.

        A record that begins with the one that was identified is continued from it, and so is one
        whose clock starts where that one's stopped.  Otherwise the memory that the first input
        does not force is unknown, unless the record states it, and widens the band until the
        input has forced it; so do hysterons that switched once for all in that record.  Of a record
        that begins as that one began, say `initial_memory="as-fitted"`.

        Arguments:
            record: the record; its output is not used.

        Returns:
            The prediction, with a 95 % band.

        Raises:
            InputError: if the input leaves the range of the plane, an auxiliary column that the
                model needs is missing, an initial memory as fitted is asked of another start, or
                what the model gives is not finite.

        Example:
            >>> import numpy as np, preisach_jax as pj
            >>> t = np.arange(2000) / 100
            >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
            >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=5).model
            >>> model.predict(pj.Record.from_arrays(t, u, u)).output.shape
            (2000,)
        """
        check_record(self.chain, self.units, record)
        run = self._run_of(record)
        output, half = run(self, record), self.half_width(record)
        low, high = output - half, output + half
        if run is Model._from_middle:
            open_, once = self._open_memory(record), self._switched_once(record)
            low, high = low - open_ + np.minimum(once, 0), high + open_ + np.maximum(once, 0)
        bad = np.flatnonzero(~(np.isfinite(low) & np.isfinite(high)))
        if bad.size:
            raise InputError(
                f"{record.name}, sample {bad[0] + 1}: the model of {self.origin.record} predicts "
                f"{output[bad[0]]} ({low[bad[0]]} to {high[bad[0]]}), which is no finite number; "
                "fit the model again"
            )
        return Prediction(record.time, output, low, high)

    def _moved_from_rest(self, record: Record) -> np.ndarray:
        """(time,) output of a body that is at rest, or in the steady state of a period."""
        return self.offset + moved(self.chain, self.values, self.weights, record, begins=False)

    def half_width(self, record: Record) -> np.ndarray:
        """Half width of the 95 % band along a record whose past is known, `(time,)`.

        Arguments:
            record: the record.

        Returns:
            That of `Model.band`; without it, 1.96 times the held-out RMS error.
        """
        if self.band is None:
            return np.full(len(record.time), 1.96 * self.rms_validation)
        run, here = self._run_of(record), (self.values, self.coefficients)
        spread = spread_of(self.chain, here, self.band.others, record, self._with_numbers(run))
        known = self.band.along(Course.of(record), spread)
        goes_on = run is not Model._from_middle
        ahead = unforeseen(self.chain, *here, self.origin.span_s, record.time, goes_on)
        return np.hypot(known, 1.96 * ahead) if self.band.law else known  # as older files had it

    def others_along(self, record: Record) -> tuple[np.ndarray, np.ndarray]:
        """What other models that its record could have led to predict minus what it does.

        Arguments:
            record: the record.

        Returns:
            (row,) samples of the record, and (model, row) differences there, in output units; no
            models where the band has none.
        """
        others = self.band.others if self.band is not None else None
        run, here = self._with_numbers(self._run_of(record)), (self.values, self.coefficients)
        return differences(self.chain, here, others, record, run)

    def _with_numbers(
        self, run: Callable[[Model, Record], np.ndarray]
    ) -> Callable[[Numbers, Record], np.ndarray]:
        return lambda there, few: run(replace(self, values=there[0], coefficients=there[1]), few)

    def _run_of(self, record: Record) -> Callable[[Model, Record], np.ndarray]:
        """What computes a model's output along a record, by what is known of its past."""
        if record.initial_memory == AS_FITTED:
            self._check_start(record)
            return Model._as_fitted
        if self.begins_with_origin(record):
            return Model.simulate
        if self.chain.mechanics:
            return Model._moved_from_rest
        return Model._continue if self.follows_origin(record) else Model._from_middle

    def _check_start(self, record: Record) -> None:
        first, began = float(record.input[0]), float(self.origin.history[1, 0])
        places = position_on(self.plane, np.array([first, began]))
        if abs(places[0] - places[1]) > 1.0:  # by more than a cell
            unit = self.units.get("input", "")
            raise InputError(
                f"{record.name}: its first input is {first:.6g} {unit}, and that of "
                f"{self.origin.record}, which the model is of, {began:.6g} {unit}: an initial "
                f"memory {AS_FITTED} needs the same; give low, high, demagnetised or free"
            )

    def _as_fitted(self, record: Record) -> np.ndarray:
        """Output of a record that begins as the identification record did, at another time."""
        moved = record.time - record.time[0] + self.origin.start_s
        return self.simulate(
            Record.from_arrays(moved, record.input, np.full(len(moved), np.nan), aux=record.aux)
        )

    def check_invertible(self) -> None:
        """Ask whether each output along a branch belongs to one input.

        Raises:
            InputError: if the weights have both signs, so that branches rise and fall, or the
                hysteresis is inside mechanics, which no inverse step of an operator undoes.
        """
        check_not_inside(self.chain, self.origin.record, "an inverse")
        if self.chain.signed and self.weights.min() < 0 < self.weights.max():
            raise InputError(
                f"the model of {self.origin.record} has weights of both signs: along a branch the "
                "output rises and falls, and no inverse step is sure; record the part of the "
                "input's range in which the output rises throughout, and fit a model to that"
            )

    def begins_with_origin(self, record: Record) -> bool:
        """Whether a record begins with the one that was identified."""
        rows = self.origin.rows
        return len(record.time) >= rows and record.inputs_digest(rows) == self.origin.inputs_sha256

    def follows_origin(self, record: Record) -> bool:
        """Whether a record's clock starts where that of the one that was identified stopped."""
        pause = record.time[0] - self.origin.stop_s
        return 0 < pause <= 10 * self.origin.step_s

    def _continue(self, record: Record) -> np.ndarray:
        time, values = self.origin.history
        count = len(time)
        aux = {name: np.concatenate([np.full(count, v[0]), v]) for name, v in record.aux.items()}
        whole = Record.from_arrays(
            np.concatenate([time, record.time]),
            np.concatenate([values, record.input]),
            np.full(count + len(record.time), np.nan),
            aux=aux,
        )
        return self.simulate(whole)[count:]

    def _drift_origin_s(self, record: Record) -> float:
        """Time from which drift and ageing count in a record that is not a continuation.

        A clock that was set back since the fit, or that has run on for longer than the record of
        the fit lasted, says nothing about how far a drift has come: it starts anew.
        """
        start, stop = self.origin.start_s, self.origin.stop_s
        first = float(record.time[0])
        return start if start <= first <= stop + (stop - start) else first

    def unknown_start(self, record: Record) -> tuple[Signals, Coefficients]:
        """What drives the model along a record that continues none, and with which coefficients.

        Arguments:
            record: the record.

        Returns:
            The signals, and the coefficients with the memory that the record states, or with the
            middle of what an unknown memory leaves open.
        """
        signals = signals_of(record, self._drift_origin_s(record))
        weights = self.weights
        if self.chain.hysteron == "relay":
            weights = exactly_summable(weights)
        stated = record.initial_memory
        if stated == "free":
            start = np.full(len(weights), 0.5)
        else:
            start = stated_start(self.chain, drive(self.chain, self.values, signals), stated)
        # What the past of the first record has left says nothing about this one's.
        lasting = np.array([each.amount for _, each in self.chain.coefficients], dtype=bool)
        added = np.where(lasting, self.coefficients.added, 0.0)
        return signals, replace(
            self.coefficients,
            weights=weights,
            memory=weights * start,
            added=added,
            first_run=np.zeros(0),
        )

    def _from_middle(self, record: Record) -> np.ndarray:
        """Output from the middle of what an unknown memory leaves open."""
        with on_processor():
            signals, coefficients = self.unknown_start(record)
            middle = hysteresis_output(self.chain, self.values, signals, coefficients)
            output = behind_hysteresis(self.chain, self.values, signals, middle, coefficients)
            return np.asarray(output)

    def _open_memory(self, record: Record) -> np.ndarray:
        """Half the width of what an unknown memory leaves open."""
        if record.initial_memory != "free":
            return np.zeros(len(record.time))
        with on_processor():
            signals, coefficients = self.unknown_start(record)
            middle = hysteresis_output(self.chain, self.values, signals, coefficients)
            lowest = replace(coefficients, memory=np.zeros_like(coefficients.weights))
            gap = jnp.abs(middle - hysteresis_output(self.chain, self.values, signals, lowest))
            # The operator lies between all hysterons off and all on.
            most, first = float(np.abs(coefficients.weights).sum()), float(jnp.abs(middle[0]))
            for effect in self.chain.at(OutputEffect):
                acting = effect.at(self.values[effect.name])
                gap = gap + acting.past_bound(signals, max(first, most - first))
            return np.asarray(gap)

    def _switched_once(self, record: Record) -> np.ndarray:
        """What hysterons that switch once for all add if they are as at the start of the fit."""
        if record.initial_memory != "free":
            return np.zeros(len(record.time))
        with on_processor():
            signals, _ = self.unknown_start(record)
            course = drive(self.chain, self.values, signals)
            return np.asarray(first_run_output(self.chain, course, self.coefficients.first_run))

    def to_json(self) -> dict[str, Any]:
        """The content of the model file."""
        from preisach_jax.model.content import content_of

        return content_of(self)

    def to_control(
        self, rate_hz: float | None = None, without: Sequence[str] = (), name: str | None = None
    ) -> NonlinearIOSystem:
        """This model as a discrete system of python-control (`pip install preisach_jax[control]`).

        Arguments:
            rate_hz: sampling rate in Hz; by default that of the record on which it was identified.
            without: names of effects that are left out.
            name: name of the system; by default that of the record.

        Returns:
            A `control.NonlinearIOSystem`: inputs and output named as the columns of the record, the
            sample interval as `dt`. Initial states of zero are those before the first sample.

        Raises:
            InputError: if python-control is not installed, an effect has no law sample by sample,
                or the rate is not positive.

        Example:
            >>> model.to_control(rate_hz=1000.0).dt  # doctest: +SKIP
            0.001
        """
        return HOOKS["Model.to_control"](self, rate_hz, without, name)

    def save(self, path: str | Path) -> None:
        """Write the model as JSON; an older file stays whole until the new one is.

        Raises:
            InputError: if the place cannot be written to.
        """
        path = Path(path)
        if not path.parent.is_dir():
            raise InputError(
                f"{path}: there is no folder {path.parent}; make it, or choose another"
            )
        write_files({path: json_bytes(self.to_json())})

    @staticmethod
    def load(path: str | Path, effects: Iterable[Effect] = ()) -> Model:
        """Read a model.

        Arguments:
            path: its file.
            effects: effects of one's own that the model holds.

        Raises:
            InputError: if the file is missing, broken, or of another format.
        """
        from preisach_jax.model.reading import load

        return load(path, effects)

    @staticmethod
    def from_json(content: Mapping[str, Any], effects: Iterable[Effect] = ()) -> Model:
        """A model from the content of its file.

        Arguments:
            content: what `to_json` gave, or JSON of it.
            effects: effects of one's own that the model holds.

        Returns:
            The model.

        Raises:
            InputError: if the content is that of no model, damaged, or of another format.

        Example:
            >>> import numpy as np, preisach_jax as pj
            >>> t = np.arange(2000) / 100
            >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
            >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=5).model
            >>> bool(np.all(pj.Model.from_json(model.to_json()).weights == model.weights))
            True
        """
        from preisach_jax.model.reading import model_from

        return model_from(content, effects)
