"""A model with its numbers, what it predicts, and what it asks of a record."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain, model_name
from preisach_jax.chain.driven import drive
from preisach_jax.chain.hysteresis import first_run_output, hysteresis_output, stated_start
from preisach_jax.chain.output import behind_hysteresis, response
from preisach_jax.chain.signals import signals_of
from preisach_jax.cores import on_processor
from preisach_jax.effects.base import Effect, OfColumn, OutputEffect, Signals
from preisach_jax.errors import InputError, require_list
from preisach_jax.files import json_bytes, write_files
from preisach_jax.hooks import HOOKS
from preisach_jax.mechanics import FARTHEST, along, at_rest, body_of, closes, fitted_start
from preisach_jax.model.band import (
    Band,
    InputMotion,
    Numbers,
    differences,
    drift_deviation,
    spread_of,
)
from preisach_jax.model.origin import FORMAT, FORMAT_VERSION, Origin, ParameterEstimate
from preisach_jax.operator.plane import Plane, position_on
from preisach_jax.quantity import pretty_unit, quantity
from preisach_jax.record.core import Record
from preisach_jax.record.samples import AS_FITTED

if TYPE_CHECKING:
    from control import NonlinearIOSystem


RANGE_TOLERANCE = 0.01
"""Share of the input range by which an input may leave the plane: noise of a converter does."""

PAST_COUNTS = 0.5
"""Share of the half width with a known past from which on what an unknown one adds is said."""


@dataclass(frozen=True)
class Prediction:
    """A simulated output with its 95 % band, `(time,)` each, in output units; time in s."""

    time: np.ndarray
    output: np.ndarray
    low: np.ndarray
    high: np.ndarray


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
        band: the 95 % band, calibrated on rows that did not identify what predicts them; None of a
            model without some of its effects.
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
            return self._displaced(record, begins=True)
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
            >>> t = np.arange(3000) / 100
            >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
            >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
            >>> model.predict(pj.Record.from_arrays(t, u, u)).output.shape
            (3000,)
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
        return self._displaced(record, begins=False)

    def _displaced(self, record: Record, *, begins: bool) -> np.ndarray:
        """(time,) output of a body along a record that `begins` as the fitted one did.

        Another begins at rest, or in the steady state of an input that closes as a period does.
        """
        effect, plane = self.chain.mechanics, self.plane
        assert effect is not None
        own = self.values[effect.name]
        time, force, f_hz = record.time, record.input, own["f_hz"]
        with on_processor():
            body = body_of(effect, own, plane, self.weights)
            start = fitted_start(effect, plane) if begins else at_rest(effect, plane)
            if not begins and closes(time, force):
                start = along(body, start, *_once_more(time, force), f_hz)[1]
            path = along(body, start, time, force, f_hz)[0]
        farthest = FARTHEST * max(abs(plane.low), abs(plane.high))
        beyond = np.flatnonzero(~(np.abs(path) <= farthest))
        if len(beyond):
            raise InputError(
                f"{record.name}: along this input the output comes to {path[beyond[0]]:.4g} "
                f"{record.output_unit} from rest in sample {beyond[0] + 1}, and the model "
                f"knows it up to {farthest / FARTHEST:.4g}; fit it to a record that goes as far"
            )
        return self.offset + path

    def half_width(self, record: Record) -> np.ndarray:
        """Half width of the 95 % band along a record whose past is known, `(time,)`.

        Without a band it is 1.96 times the held-out RMS error.
        """
        if self.band is None:
            return np.full(len(record.time), 1.96 * self.rms_validation)
        run, here = self._run_of(record), (self.values, self.coefficients)
        spread = spread_of(self.chain, here, self.band.others, record, self._with_numbers(run))
        known = self.band.along(InputMotion.of(record), spread)
        goes_on = run is not Model._from_middle
        ahead = drift_deviation(self.chain, *here, self.origin.span_s, record.time, goes_on)
        return np.hypot(known, 1.96 * ahead)

    def others_along(self, record: Record) -> tuple[np.ndarray, np.ndarray]:
        """Rows of a record, and (model, row) what the band's other models predict more there."""
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

    def knows_the_past_of(self, record: Record) -> bool:
        """Whether what came before a record is known, or stated."""
        return self._run_of(record) is not Model._from_middle

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
        """Signals and coefficients along a record that continues none.

        The memory is the one that the record states, or the middle of what is left open.
        """
        origin = self._drift_origin_s(record)
        signals = signals_of(record, origin)
        if not record.has_clock and origin < record.time[0]:
            history = self.origin.history
            moves: np.ndarray = np.abs(np.diff(history[1], prepend=history[1, 0]))
            gone: np.ndarray = np.interp(record.time[:1], history[0], np.cumsum(moves))
            signals = replace(signals, gone=signals.path + gone)
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
            lowest = replace(coefficients, memory=np.zeros_like(coefficients.weights))
            middle, low = (
                np.asarray(hysteresis_output(self.chain, self.values, signals, each))
                for each in (coefficients, lowest)
            )
            gap = np.abs(middle - low)
            # The operator lies between all hysterons off and all on.
            most, first = float(np.abs(coefficients.weights).sum()), float(np.abs(middle[0]))
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
        own = self.plane.own_thresholds
        return {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "library_version": version("preisach_jax"),
            "hysteron": self.chain.hysteron,
            "levels": self.plane.levels,
            "low": self.plane.low,
            "high": self.plane.high,
            **({} if own is None else {"thresholds": own.tolist()}),
            "offset": self.offset,
            "weights": self.weights.tolist(),
            "memory": self.coefficients.memory.tolist(),
            "first_run": self.coefficients.first_run.tolist(),
            "visited": self.visited.astype(int).tolist(),
            "effects": [
                {
                    "name": effect.name,
                    "settings": effect.settings(),
                    "parameters": {
                        name: asdict(estimate)
                        for name, estimate in self.parameters[effect.name].items()
                    },
                }
                for effect in self.effects
            ],
            "columns": dict(self.columns),
            "units": dict(self.units),
            "sampling": {"step_s": self.origin.step_s, "rows": self.origin.rows},
            "identification": asdict(self.origin) | {"history": self.origin.history.tolist()},
            "rms_validation": self.rms_validation,
            "noise": self.noise,
            "discretisation": self.discretisation,
            "band": None if self.band is None else self.band.to_json(),
        }

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
        from preisach_jax.model.file import read

        path = Path(path)
        content = read(path)
        try:
            return Model.from_json(content, effects)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

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
            >>> t = np.arange(3000) / 100
            >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
            >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=9).model
            >>> bool(np.all(pj.Model.from_json(model.to_json()).weights == model.weights))
            True
        """
        from preisach_jax.model.file import fields_of

        return Model(**fields_of(content, effects))


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


def exactly_summable(weights: np.ndarray) -> np.ndarray:
    """(cells,) weights rounded so that sums of them are exact in any order.

    They become whole multiples of 2^-51 of a power of two above the sum of their sizes, so that
    relays give the same output to the bit here, all at once, and in C, from a table.
    """
    total = float(np.abs(weights).sum())
    step = 2.0 ** (math.frexp(total)[1] - 51)
    return np.round(weights / step) * step if total > 0 else weights


def check_not_inside(chain: Chain, origin: str, what: str) -> None:
    """Ask whether a model's hysteresis is driven by its input."""
    if chain.mechanics:
        raise InputError(
            f"the model of {origin} has its hysteresis inside mechanics "
            f"(restoring_force): there is {what} only of models whose input drives the hysteresis; "
            "predict and compare work with it, or fit a model of other effects"
        )


def _once_more(time: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The period before a record that repeats, up to its first sample."""
    step = float(np.median(np.diff(time)))
    length = time[-1] - time[0] + step
    return np.append(time - length, time[0]), np.append(force, force[0])


def check_record(chain: Chain, units: Mapping[str, str], record: Record) -> None:
    """Refuse a record along which a model of these units by role cannot predict."""
    _check_units(units, record)
    check_clock(chain.effects, record)
    if chain.mechanics:
        return  # the plane is one of displacements, and `_displaced` asks whether they stay on it
    plane = chain.plane
    reach = RANGE_TOLERANCE * (plane.high - plane.low)
    beyond = np.flatnonzero(
        (record.input < plane.low - reach) | (record.input > plane.high + reach)
    )
    if len(beyond):
        row = int(beyond[0])
        unit = units.get("input", "")
        raise InputError(
            f"{record.name}: the input {record.input[row]:.6g} {unit} in sample {row + 1} lies "
            f"outside the range {plane.low:.6g} to {plane.high:.6g} {unit} on which the model "
            f"was identified ({len(beyond)} such samples); identify a model on a record that "
            "covers it, or cut these samples out"
        )
    for effect in chain.effects:
        if isinstance(effect, OfColumn) and effect.column not in record.aux:
            raise InputError(
                f"{record.name}: the model needs the auxiliary column {effect.column!r}; "
                f"load the record with it (--aux {effect.column})"
            )


def check_clock(effects: Iterable[Effect], record: Record) -> None:
    """Refuse effects that go with times or rates, for a record that only counts samples."""
    late = next((e.name for e in effects if e.needs_clock and not record.has_clock), None)
    if late is not None:
        raise InputError(
            f"{record.name}: the effect {late!r} needs a clock, and the samples are only "
            "counted; give the column of time (--time COL) or the sampling rate (--rate HZ)"
        )


def _check_units(units: Mapping[str, str], record: Record) -> None:
    for role in ("input", "output", *record.aux):
        own, given = (
            pretty_unit(unit) for unit in (units.get(role, ""), record.channels[role].unit)
        )
        if own and given and own != given:
            raise InputError(
                f"{record.name}, column {record.channels[role].name}: its unit is {given}, and "
                f"the model was identified in {own}; convert the column, or fit a model to it"
            )


def past_sentence(model: Model, record: Record, prediction: Prediction) -> str:
    """Why a band is wider than that of a known past, for how long, and what narrows it."""
    if model.knows_the_past_of(record):
        return ""
    known = model.half_width(record)
    added = (prediction.high - prediction.low) / 2 - known
    wide = np.flatnonzero(added > PAST_COUNTS * known)
    if not len(wide):
        return ""
    unit, last = model.units.get("output", ""), int(wide[-1])
    plane, in_unit = model.plane, pretty_unit(model.units.get("input", ""))
    widest = int(np.argmax(added))
    until = "to the last row"
    if last + 1 < len(record):
        after = float(record.time[last + 1] - record.time[0])
        until = f"until row {last + 2:,}, {quantity(after, 's')} after the first"
    span = f"{plane.low:.6g} to {plane.high:.6g} {in_unit}".rstrip()
    return (
        "what the input did before row 1 is not known, so that the band is wider, by up to "
        f"±{quantity(float(added[widest]), unit, 3)} (with a known past it is "
        f"±{quantity(float(known[widest]), unit, 3)}), {until}; to narrow it, begin the record "
        f"with a sweep over the whole range ({span}), or say --initial-memory low, high, "
        f"demagnetised or as-fitted, or record without a pause behind {model.origin.record}, on "
        "its clock"
    )
