"""A model with its numbers: what it predicts, and its file."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from preisach_jax import html
from preisach_jax.band import SLICES, Band
from preisach_jax.chain import (
    Chain,
    Coefficients,
    behind_hysteresis,
    drive,
    hysteresis_output,
    response,
    signals_of,
    stated_start,
)
from preisach_jax.effects import BUILT_IN, library, placeholder
from preisach_jax.effects.base import Effect, OutputEffect, Signals
from preisach_jax.effects.of_column import OfColumn
from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes, write_files
from preisach_jax.operator.checks import HYSTERONS
from preisach_jax.operator.plane import Plane
from preisach_jax.quantity import pretty_unit
from preisach_jax.record import INITIAL_MEMORIES, Record
from preisach_jax.rows import chain_rows, model_line
from preisach_jax.schema import (
    bound,
    checked,
    items,
    like,
    list_of,
    number,
    numbers,
    one_of,
    refusal,
    share,
    table,
    table_of,
    text,
    whole,
)
from preisach_jax.upgrade import upgraded

if TYPE_CHECKING:
    from control import NonlinearIOSystem

FORMAT = "preisach_jax model"
FORMAT_VERSION = 3

RANGE_TOLERANCE = 0.01
"""Share of the input range by which an input may leave the plane: noise of a converter does."""


@dataclass(frozen=True)
class ParameterEstimate:
    """A value with its 95 % interval and its unit."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Prediction:
    """A simulated output with its 95 % band, `(time,)` each, in output units; time in s."""

    time: np.ndarray
    output: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Origin:
    """The record on which a model was identified.

    Attributes:
        record: its name.
        sha256: hash of its values.
        rows: its number of rows.
        inputs_sha256: hash of its time and input columns.
        start_s, stop_s: time of its first and its last row, in s.
        step_s: its median time step, in s.
        initial_memory: what was assumed of the hysterons before the first row.
        history: (2, point) time in s and input, thinned without losing a reversal, from which a
            record that begins where this one ended is continued.
    """

    record: str
    sha256: str
    rows: int
    inputs_sha256: str
    start_s: float
    stop_s: float
    step_s: float
    initial_memory: str
    history: np.ndarray

    @staticmethod
    def of(record: Record) -> Origin:
        """What a model remembers of its record."""
        rows = len(record.time)
        return Origin(
            record.name,
            record.sha256,
            rows,
            record.inputs_digest(rows),
            float(record.time[0]),
            float(record.time[-1]),
            record.step_s,
            record.initial_memory,
            _thinned(record.time, record.input),
        )


def exactly_summable(weights: np.ndarray) -> np.ndarray:
    """Weights rounded so that sums of them are exact in any order.

    They become whole multiples of a step, 2^-51 of a power of two above the sum of their sizes, so
    that relays give the same output to the bit however it is summed: here all at once, in generated
    code from a table.

    Arguments:
        weights: (cells,) weights.

    Returns:
        (cells,) weights, changed by less than 5e-16 of the sum of their sizes.

    Example:
        >>> w = exactly_summable(np.random.default_rng(0).uniform(size=100))
        >>> bool(w.sum() == w[::-1].cumsum()[-1])
        True
    """
    total = float(np.abs(weights).sum())
    step = 2.0 ** (math.frexp(total)[1] - 51)
    return np.round(weights / step) * step if total > 0 else weights


def _thinned(time: np.ndarray, values: np.ndarray, bins: int = 600) -> np.ndarray:
    """A course with its first, last, least and greatest value in each of some stretches."""
    keep = {0, len(values) - 1}
    for rows in np.array_split(np.arange(len(values)), min(bins, len(values))):
        part = values[rows]
        keep |= {int(rows[0]), int(rows[np.argmin(part)]), int(rows[np.argmax(part)])}
    order = np.array(sorted(keep))
    return np.stack([time[order], values[order]])


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
        band: the 95 % band by slices, calibrated on the rows that were held out; of models that
            were written before there was one, None.
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

    def __repr__(self) -> str:
        return f"<Model {model_line(self)}>"

    def _repr_html_(self) -> str:
        """The chain in its order, with parameters and their intervals, for notebooks."""
        return html.block(
            html.heading(model_line(self)),
            html.table(("acts on", "part", "parameter", "value"), chain_rows(self)),
            html.sentence(f"Identified on {self.origin.record}, {self.origin.rows:,} rows."),
        )

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

    def with_budget(self, noise: float, discretisation: float) -> Model:
        """The same model, knowing what its error is made of."""
        return replace(self, noise=noise, discretisation=discretisation)

    def simulate(self, record: Record) -> np.ndarray:
        """Output along a record that starts as the identification record did, `(time,)`."""
        with jax.enable_x64(True):
            signals = signals_of(record, self.origin.start_s)
            return np.asarray(response(self.chain, self.values, signals, self.coefficients))

    def predict(self, record: Record) -> Prediction:
        """Predict the output of a record from its input (and auxiliary columns) alone.

        A record that begins with the one that was identified is continued from it, and so is one
        whose clock starts where that one's stopped.  Otherwise the memory that the first input
        does not force is unknown, unless the record states it, and widens the band until the
        input has forced it.

        Arguments:
            record: the record; its output is not used.

        Returns:
            The prediction; its band is that of the slices of `Model.band`, and what memory leaves
            open.

        Raises:
            InputError: if the input leaves the range of the plane, or an auxiliary column that the
                model needs is missing.

        Example:
            >>> import numpy as np, preisach_jax as pj
            >>> t = np.arange(2000) / 100
            >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
            >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=5).model
            >>> model.predict(pj.Record.from_arrays(t, u, u)).output.shape
            (2000,)
        """
        self._check(record)
        sure = np.zeros(len(record.time))
        if self.begins_with_origin(record):
            output, gap = self.simulate(record), sure
        elif self.follows_origin(record):
            output, gap = self._continue(record), sure
        else:
            output, gap = self._from_unknown_memory(record)
        half = self.half_width(record) + gap
        return Prediction(record.time, output, output - half, output + half)

    def half_width(self, record: Record) -> np.ndarray:
        """Half width of the 95 % band along a record whose past is known, `(time,)`.

        Arguments:
            record: the record.

        Returns:
            That of the slices in which rows were held out; without them, 1.96 times the held-out
            RMS error.
        """
        if self.band is None:
            return np.full(len(record.time), 1.96 * self.rms_validation)
        return self.band.along(record)

    def _check(self, record: Record) -> None:
        self._check_units(record)
        plane = self.plane
        reach = RANGE_TOLERANCE * (plane.high - plane.low)
        beyond = np.flatnonzero(
            (record.input < plane.low - reach) | (record.input > plane.high + reach)
        )
        if len(beyond):
            row = int(beyond[0])
            unit = self.units.get("input", "")
            raise InputError(
                f"{record.name}: the input {record.input[row]:.6g} {unit} in sample {row + 1} lies "
                f"outside the range {plane.low:.6g} to {plane.high:.6g} {unit} on which the model "
                f"was identified ({len(beyond)} such samples); identify a model on a record that "
                "covers it, or cut these samples out"
            )
        for effect in self.effects:
            if isinstance(effect, OfColumn) and effect.column not in record.aux:
                raise InputError(
                    f"{record.name}: the model needs the auxiliary column {effect.column!r}; "
                    f"load the record with it (--aux {effect.column})"
                )

    def _check_units(self, record: Record) -> None:
        for role in ("input", "output", *record.aux):
            own, given = (
                pretty_unit(units)
                for units in (self.units.get(role, ""), record.channels[role].unit)
            )
            if own and given and own != given:
                raise InputError(
                    f"{record.name}, column {record.channels[role].name}: its unit is {given}, and "
                    f"the model was identified in {own}; convert the column, or fit a model to it"
                )

    def check_invertible(self) -> None:
        """Ask whether each output along a branch belongs to one input.

        Raises:
            InputError: if the weights have both signs, so that branches rise and fall.
        """
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

    def _from_unknown_memory(self, record: Record) -> tuple[np.ndarray, np.ndarray]:
        """Output from the middle of what memory leaves open, and half the width of that."""
        with jax.enable_x64(True):
            signals, coefficients = self.unknown_start(record)
            middle = hysteresis_output(self.chain, self.values, signals, coefficients)
            output = behind_hysteresis(self.chain, self.values, signals, middle, coefficients)
            if record.initial_memory != "free":
                return np.asarray(output), np.zeros(len(record.time))
            weights = coefficients.weights
            lowest = replace(coefficients, memory=np.zeros_like(weights))
            gap = jnp.abs(middle - hysteresis_output(self.chain, self.values, signals, lowest))
            # The operator lies between all hysterons off and all on.
            most, first = float(np.abs(weights).sum()), float(jnp.abs(middle[0]))
            for effect in self.chain.at(OutputEffect):
                own = self.values[effect.name]
                gap = gap + effect.past_bound(own, signals, max(first, most - first))
            return np.asarray(output), np.asarray(gap)

    def to_json(self) -> dict[str, Any]:
        """The content of the model file."""
        origin = asdict(self.origin) | {"history": self.origin.history.tolist()}
        return {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "library_version": version("preisach_jax"),
            "hysteron": self.chain.hysteron,
            "levels": self.plane.levels,
            "low": self.plane.low,
            "high": self.plane.high,
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
            "identification": origin,
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
        from preisach_jax.export.control import to_control

        return to_control(self, rate_hz, without, name)

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
    def load(
        path: str | Path,
        effects: Iterable[Effect] = (),
        *,
        announce: Callable[[str], object] | None = None,
    ) -> Model:
        """Read a model; one of an older format predicts what it did, and is saved in the present.

        Arguments:
            path: its file.
            effects: effects of one's own that the model holds.
            announce: called with a sentence if the file is of an older format.

        Raises:
            InputError: if the file is missing, broken, or written by a newer version.
        """
        path = Path(path)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except RecursionError:
            raise InputError(
                f"{path}: this is no model file (its JSON is nested too deeply); write one with "
                "'preisach fit ... --out model.json'"
            ) from None
        except OSError as error:
            raise InputError(
                f"{path}: the model cannot be read ({error.strerror}); check the path"
            ) from error
        except ValueError as error:
            raise InputError(
                f"{path}: this is no model file (it is not valid JSON: {error}); write one with "
                "'preisach fit ... --out model.json'"
            ) from error
        try:
            model = Model.from_json(content, effects)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        if announce is not None and content["format_version"] < FORMAT_VERSION:
            announce(
                f"{path}: upgraded from format version {content['format_version']} to "
                f"{FORMAT_VERSION} as it was read; the file stays as it is"
            )
        return model

    @staticmethod
    def from_json(content: Mapping[str, Any], effects: Iterable[Effect] = ()) -> Model:
        """A model from the content of its file.

        Arguments:
            content: what `to_json` gave, now or in an older format, or JSON of it.
            effects: effects of one's own that the model holds.

        Returns:
            The model.

        Raises:
            InputError: if the content is that of no model, damaged, or of a newer version.

        Example:
            >>> import numpy as np, preisach_jax as pj
            >>> t = np.arange(2000) / 100
            >>> u = 5 - 5 * np.cos(t * (1 + t / 40))
            >>> model = pj.fit(pj.Record.from_arrays(t, u, u**1.1), levels=5).model
            >>> bool(np.all(pj.Model.from_json(model.to_json()).weights == model.weights))
            True
        """
        if not isinstance(content, Mapping) or content.get("format") != FORMAT:
            raise InputError(
                f"this JSON is no model of preisach_jax (no 'format': '{FORMAT}'); write one with "
                "'preisach fit ... --out model.json'"
            )
        found: Any = content.get("format_version")
        if isinstance(found, bool) or found not in range(1, FORMAT_VERSION + 1):
            written_by = content.get("library_version")
            raise InputError(
                f"the model has format version {found!r:.20} (written by preisach_jax "
                f"{written_by if isinstance(written_by, str) else 'of no version':.20}), and this "
                f"library reads versions 1 to {FORMAT_VERSION}; install the version that wrote it, "
                "or fit anew"
            )
        with _told_as_damage():
            sound = checked({"band": None, **upgraded(content, int(found))}, _CONTENT)
        kinds = _kinds_of(sound["effects"], {effect.name: effect for effect in effects})
        with _told_as_damage():
            return _model_from(sound, kinds)


@contextmanager
def _told_as_damage() -> Generator[None]:
    try:
        yield
    except InputError as error:
        raise InputError(
            f"the model file is damaged ({error}); mend it, or fit the model anew"
        ) from error


MOST_COLUMNS = 1000
"""Most columns that an effect may have where a file says how many: a built-in one has some ten."""

_ESTIMATE = {"value": number(), "low": bound, "high": bound, "unit": text}


def _band(value: Any, place: str) -> Band | None:
    if value is None:
        return None
    found = checked(value, {"speed": numbers, "since_s": numbers, "half": numbers}, place)
    for key, count in (("speed", SLICES - 1), ("since_s", SLICES - 1), ("half", SLICES**2)):
        if len(found[key]) != count:
            raise InputError(f"{place}.{key} is a list of {len(found[key])}: expected {count}")
    return Band.from_json(found)


_CONTENT = {
    "hysteron": one_of(*HYSTERONS),
    "levels": whole(2),
    "low": number(),
    "high": number(),
    "offset": number(),
    "weights": numbers,
    "memory": numbers,
    "first_run": numbers,
    "visited": items,
    "effects": list_of({"name": text, "settings": table, "parameters": table_of(_ESTIMATE)}),
    "columns": {"time": text, "input": text, "output": text, "aux": list_of(text)},
    "units": table_of(text),
    "sampling": {"step_s": number(0.0), "rows": whole(2)},
    "identification": {
        "record": text,
        "sha256": text,
        "rows": whole(2),
        "inputs_sha256": text,
        "start_s": number(),
        "stop_s": number(),
        "step_s": number(0.0),
        "initial_memory": one_of(*INITIAL_MEMORIES),
        "history": list_of(numbers, least=2),
    },
    "rms_validation": number(0.0),
    "noise": share,
    "discretisation": share,
    "band": _band,
}
"""What the file of a model holds, apart from what says that it is one."""


def _model_from(content: dict[str, Any], kinds: Sequence[Effect]) -> Model:
    """A model from checked content; what belongs together is checked first."""
    _check_plane(content)
    effects = _effects_from(content["effects"], kinds)
    plane = Plane(content["levels"], content["low"], content["high"])
    weights = content["weights"]
    polarity = -1 if weights.sum() < 0 else 1
    signed = bool((weights < 0).any() and (weights > 0).any())
    chain = Chain(plane, effects, content["hysteron"], polarity, signed)
    parameters = _parameters_from(content["effects"], chain)
    values = {
        effect.name: {
            parameter.name: parameters[effect.name][parameter.name].value
            for parameter in effect.parameters()
        }
        for effect in effects
    }
    added = [parameters[effect][each.name].value for effect, each in chain.coefficients]
    return Model(
        chain=chain,
        values=values,
        coefficients=Coefficients(
            content["weights"],
            content["memory"],
            content["offset"],
            np.asarray(added),
            content["first_run"],
        ),
        parameters=parameters,
        visited=np.array(content["visited"], dtype=bool),
        columns=content["columns"],
        units=content["units"],
        origin=_origin_from(content["identification"]),
        rms_validation=content["rms_validation"],
        noise=content["noise"],
        discretisation=content["discretisation"],
        band=content["band"],
    )


def _check_plane(content: dict[str, Any]) -> None:
    """Refuse limits that are none, and arrays that do not fit the levels."""
    if not content["low"] < content["high"]:
        raise refusal(content["low"], "low", f"a number below high, which is {content['high']}")
    levels = content["levels"]
    cells = levels * (levels + 1) // 2
    counts = {"weights": (cells,), "memory": (cells,), "visited": (cells,)}
    for name, allowed in (counts | {"first_run": (0, 2 * levels)}).items():
        if len(content[name]) not in allowed:
            expected = f"as many numbers as {levels} levels have cells, {cells}"
            if name == "first_run":
                expected = f"two numbers a level, {2 * levels}, or none"
            raise InputError(f"{name} is a list of {len(content[name])}: expected {expected}")
    for i, visited in enumerate(content["visited"]):
        if visited not in (0, 1):
            raise refusal(visited, f"visited[{i}]", "0 or 1")


def _kinds_of(entries: list[dict[str, Any]], own: Mapping[str, Effect]) -> list[Effect]:
    """One effect of the kind of each entry, of one's own or of the library."""
    known = library() | dict(own) if entries else {}
    kinds: list[Effect] = []
    for entry in entries:
        name = entry["name"]
        kind = known.get(name if name in own else placeholder(name))
        if kind is None:
            raise InputError(
                f"the model holds the effect {name!r:.60}, which this library does not know; pass "
                "it: Model.load(path, effects=[...])"
            )
        kinds.append(kind)
    return kinds


def _effects_from(entries: list[dict[str, Any]], kinds: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of a file, with the settings that it gives them."""
    names = [entry["name"] for entry in entries]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise refusal(name, f"effects[{i}].name", "each effect once")
    return tuple(
        _set(kind, entry, f"effects[{i}]")
        for i, (kind, entry) in enumerate(zip(kinds, entries, strict=True))
    )


def _set(pattern: Effect, entry: dict[str, Any], place: str) -> Effect:
    """The effect of a pattern's kind with the settings of a file."""
    most = MOST_COLUMNS if type(pattern) in BUILT_IN else sys.maxsize
    fields = pattern.settings()
    for key in entry["settings"]:
        if key not in fields:
            expected = f"one of {', '.join(fields)}" if fields else "none"
            raise InputError(f"{place}.settings has {key!r:.60}: expected {expected}")
    settings = {
        key: checked(value, like(fields[key], most), f"{place}.settings.{key}")
        for key, value in entry["settings"].items()
    }
    try:
        effect = type(pattern)(**settings)
        declared = [*effect.parameters(), *getattr(effect, "coefficients", tuple)()]
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"{place}.settings are of no {entry['name']}: {error}") from error
    if effect.name != entry["name"]:
        raise refusal(entry["name"], f"{place}.name", f"{effect.name!r:.60}, by its settings")
    checked(
        entry["parameters"],
        {parameter.name: table for parameter in declared},
        f"{place}.parameters",
    )
    return effect


def _parameters_from(
    entries: list[dict[str, Any]], chain: Chain
) -> dict[str, dict[str, ParameterEstimate]]:
    """The estimates of a file; values outside the bounds of their effects are refused."""
    parameters = {
        entry["name"]: {
            name: ParameterEstimate(
                estimate["value"],
                -np.inf if estimate["low"] is None else estimate["low"],
                np.inf if estimate["high"] is None else estimate["high"],
                estimate["unit"],
            )
            for name, estimate in entry["parameters"].items()
        }
        for entry in entries
    }
    for i, effect in enumerate(chain.effects):
        for parameter in effect.parameters():
            place = f"effects[{i}].parameters.{parameter.name}.value"
            value = parameters[effect.name][parameter.name].value
            checked(value, number(float(parameter.low), float(parameter.high)), place)
    return parameters


def _origin_from(content: dict[str, Any]) -> Origin:
    place = "identification.history"
    if len(content["history"]) != 2 or len({len(row) for row in content["history"]}) != 1:
        raise InputError(f"{place} must be two lists of one length: time and input")
    history = np.stack(content["history"])
    if history.shape[1] < 2 or not np.all(np.diff(history[0]) > 0):
        raise InputError(f"{place}[0] must be at least two times, each above the one before")
    if not content["start_s"] < content["stop_s"]:
        raise refusal(content["stop_s"], "identification.stop_s", "a time above start_s")
    remembered: dict[str, Any] = content | {"history": history}
    return Origin(**remembered)
