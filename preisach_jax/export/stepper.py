"""A model in discrete time, sample by sample, in NumPy: for simulations that keep its state.

The laws are those of the generated C code; the hysterons are kept one by one, as the lowest and
the highest state that the unknown start leaves possible.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from preisach_jax.effects.places import Place
from preisach_jax.export.description import Description, Part
from preisach_jax.operator.plane import position_on

State = dict[str, np.ndarray]

_HALVINGS = 200
_MAP_ROUNDS = 60


def start(model: Description) -> State:
    """State before the first sample, whose past is not known."""
    cells = len(model.weights)
    state = {"started": np.zeros(1), "samples": np.zeros(1), "low": np.zeros(cells)}
    state |= {"high": np.ones(cells), "seen": np.zeros(3), "path": np.zeros(2)}
    state |= {"input": np.zeros(1), "aux": np.zeros(len(model.aux)), "h": np.zeros(1)}
    for part in model.parts:
        size = _sizes(part)
        if size:
            state[part.name] = np.zeros(size)
    return state


def _sizes(part: Part) -> int:
    """How many numbers a part remembers."""
    fixed = {"input_lag": 5, "slew_limit": 2, "output_lag": 2, "resonance": 3, "auxiliary": 2}
    fixed["rate_dependence"] = 1
    if part.kind in ("creep", "operator_creep"):
        return len(_row(part, "gain")) + (part.kind == "creep")
    if part.kind == "reptation":
        return 2 * len(_row(part, "gain"))
    if part.kind == "delay":
        return int(_number(part, "whole")) + 1
    return fixed.get(part.kind, 0)


def _row(part: Part, name: str) -> np.ndarray:
    return np.asarray(part.numbers[name], dtype=float)


def _number(part: Part, name: str) -> float:
    return float(cast(float, part.numbers[name]))


def advance(model: Description, state: State, inputs: np.ndarray) -> tuple[State, float]:
    """Take in one sample.

    Arguments:
        inputs: (1 + auxiliary columns,) input and auxiliary columns.

    Returns:
        The state after it, and the output.
    """
    if state["started"][0] == 1 and model.part("rate_dependence") is not None:
        state = _begun_again(model, state, inputs)
    return _taken_in(model, state, inputs, 0.0)


def _begun_again(model: Description, state: State, inputs: np.ndarray) -> State:
    """The state after the first sample, with the speed at it that the second one tells."""
    path, _ = _driven(model, state, float(inputs[0]))
    shift = _widening(model, state, path)
    first = np.concatenate([state["input"], state["aux"]])
    begin = start(model) | {"samples": state["samples"] - 1}
    return _taken_in(model, begin, first, shift)[0]


def _taken_in(
    model: Description, state: State, inputs: np.ndarray, first_shift: float
) -> tuple[State, float]:
    reach = model.input_low, model.input_high
    u = float(np.clip(inputs[0], *reach))
    path, new = _driven(model, state, u)
    shift = _widening(model, state, path) if state["started"][0] else first_shift
    h, hysterons = _hysterons(model, state, path, shift)
    new |= hysterons
    signal = h * _gain(model, state)
    for part in model.at(Place.OUTPUT):
        signal, own = _OUTPUT[part.kind](part, state, signal)
        new[part.name] = own
    signal += model.offset
    for part in model.at(Place.ADDED):
        column = [c.name for c in model.aux].index(part.name[4:]) if part.kind == "auxiliary" else 0
        value = float(inputs[1 + column]) if part.kind == "auxiliary" else u
        added, own = _ADDED[part.kind](part, state, value)
        signal += added
        if own is not None:
            new[part.name] = own
    for part in model.sensor:
        if part.kind == "output_nonlinearity":
            signal = _mapped(part, signal)
        else:
            signal = _number(part, "step") * float(np.round(signal / _number(part, "step")))
    new |= {
        "started": np.minimum(state["started"] + 1, 2),
        "samples": state["samples"] + 1,
        "input": np.array([u]),
        "aux": np.asarray(inputs[1:], dtype=float),
        "path": np.array([path, state["path"][0] if state["started"][0] else path]),
    }
    return state | new, signal


def _low_pass(part: Part, output: Any, last: float, value: float) -> Any:
    decay, share = np.asarray(part.numbers["decay"]), np.asarray(part.numbers["share"])
    return value + decay * (output - last) - (value - last) * share


def _driven(model: Description, state: State, u: float) -> tuple[float, State]:
    """What drives the hysterons, and what the effects of the input remember."""
    new: State = {}
    begun, path = bool(state["started"][0]), u
    for part in model.at(Place.INPUT):
        if part.kind == "input_quantisation":
            path = _number(part, "step") * float(np.round(path / _number(part, "step")))
            continue
        own = state[part.name]
        new[part.name] = (_input_lag if part.kind == "input_lag" else _slew_limit)(
            part, own if begun else None, path
        )
        path = float(new[part.name][0])
    return path, new


def _input_lag(part: Part, own: np.ndarray | None, value: float) -> np.ndarray:
    if own is None:
        return np.array([value, value, value, value, 0.0])
    output, filtered, raw, earlier, bend = own.tolist()
    now = value - 2 * raw + earlier
    smaller = 0.0 if now * bend <= 0 else min(now, bend, key=abs)
    arc = _number(part, "arc") * smaller
    lagged = _low_pass(part, output, filtered, value - arc)
    return np.array([lagged, value - arc, value, raw, now])


def _slew_limit(part: Part, own: np.ndarray | None, value: float) -> np.ndarray:
    if own is None:
        return np.array([value, value])
    driven, last = own.tolist()
    most, rate = _number(part, "most"), value - last
    side = float(np.sign(last - driven))
    closing = most - side * rate
    meeting = abs(last - driven) / closing if closing > 0 else 1.0
    if meeting < 1:
        return np.array([value - (rate - np.clip(rate, -most, most)) * (1 - meeting), value])
    return np.array([driven + side * most, value])


def _widening(model: Description, state: State, path: float) -> float:
    part = model.part("rate_dependence")
    if part is None:
        return 0.0
    last, earlier = state["path"].tolist()
    way = path - last
    if not part.numbers["corners"] and state["started"][0] > 1:
        way = 1.5 * way - 0.5 * (last - earlier)
    speed = abs(way) / _number(part, "per_sample")
    power = speed ** _number(part, "exponent") if speed > 1e-6 else 0.0
    return _number(part, "coefficient") * power


def _hysterons(model: Description, state: State, path: float, shift: float) -> tuple[float, State]:
    """Output of the hysterons, and their state; one that agrees with itself if it is fed back."""
    feedback = [
        part for part in model.at(Place.HYSTERESIS) if part.kind in ("moving", "eddy_currents")
    ]
    if not feedback:
        return _switched(model, state, path, shift)

    def seen(output: float) -> float:
        x, begun = path, bool(state["started"][0])
        for part in feedback:
            if part.kind == "moving":
                low = _number(part, "low")
                moved = x - low + _number(part, "gain") * model.polarity * output
                x = low + moved / _number(part, "scale")
            elif begun:
                x -= _number(part, "gain") * model.polarity * (output - float(state["h"][0]))
        return x

    most = 1.5 * float(model.weights.sum())
    bottom, top = min(most, 0.0), max(most, 0.0)
    trial = float(state["h"][0])
    h, new = _switched(model, state, seen(trial), shift)
    for _ in range(_HALVINGS):
        bottom, top = (trial, top) if h > trial else (bottom, trial)
        if h == trial or not bottom < 0.5 * (bottom + top) < top:
            break
        trial = 0.5 * (bottom + top)
        h, new = _switched(model, state, seen(trial), shift)
    return h, new | {"h": np.array([h])}


def _switched(model: Description, state: State, path: float, shift: float) -> tuple[float, State]:
    rows, columns = _cells(model.levels)
    seen = (np.array([path - shift, path + shift, path]) - model.low) / (model.high - model.low)
    last = state["seen"] if state["started"][0] else seen
    ways = [_reached(model, now, before) for now, before in zip(seen, last, strict=True)]
    on_alpha, on_beta = ways[0][0][rows], ways[1][1][columns]
    rate = model.part("rate_dependence")
    if rate is not None and not rate.numbers["reversible"]:
        own_alpha, own_beta = ways[2]
        on_alpha = np.where(rows == columns, own_alpha[rows], on_alpha)
        on_beta = np.where(rows == columns, own_beta[columns], on_beta)
    low, high = (np.minimum(on_beta, np.maximum(state[k], on_alpha)) for k in ("low", "high"))
    output = float(0.5 * model.weights @ (low + high))
    return output, {"low": low, "high": high, "seen": seen}


@functools.cache
def _cells(levels: int) -> tuple[np.ndarray, np.ndarray]:
    return np.tril_indices(levels)


def _reached(model: Description, now: float, before: float) -> tuple[np.ndarray, np.ndarray]:
    """How far an input has reached thresholds α, and how far it has not left thresholds β."""
    if model.hysteron == "ramp":
        reached = np.clip(position_on(model.plane, now) - np.arange(model.levels), 0.0, 1.0)
        return reached, reached
    thresholds = model.plane.thresholds
    on_alpha = now >= thresholds if now > before else now > thresholds
    on_beta = now > thresholds if now < before else now >= thresholds
    return on_alpha.astype(float), on_beta.astype(float)


def _gain(model: Description, state: State) -> float:
    part = model.part("ageing")
    if part is None:
        return 1.0
    turn = _number(part, "per_sample") * float(state["samples"][0])
    return 1 - _number(part, "loss") * math.expm1(turn)


def _creep(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    own, gain = state[part.name], _row(part, "gain")
    crept = np.full(len(gain), value)
    if state["started"][0]:
        crept = _low_pass(part, own[1:], own[0], value)
    return value + float(gain @ crept), np.append(value, crept)


def _output_lag(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    output, last = state[part.name].tolist()
    lagged = float(_low_pass(part, output, last, value)) if state["started"][0] else value
    return lagged, np.array([lagged, value])


def _delay(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    own = state[part.name] if state["started"][0] else np.full(len(state[part.name]), value)
    course = np.append(value, own)  # the newest first
    after, oldest = course[-2:]
    return float(after + _number(part, "part") * (oldest - after)), course[:-1]


def _resonance(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    away, speed, last = state[part.name].tolist()
    if not state["started"][0]:
        return value, np.array([0.0, 0.0, value])
    before = np.array([away, speed, value - last])
    away, speed = float(_row(part, "away") @ before), float(_row(part, "speed") @ before)
    return value + away, np.array([away, speed, value])


def _drift(part: Part, state: State, value: float) -> tuple[float, None]:
    turn = _number(part, "per_sample") * float(state["samples"][0])
    if "waves" not in part.numbers:
        return _number(part, "amplitude") * math.expm1(turn), None
    waves = _row(part, "waves")
    return float(waves @ np.cos(np.pi * min(turn, 1.0) * np.arange(1, len(waves) + 1))), None


def _hum(part: Part, state: State, value: float) -> tuple[float, None]:
    cosine, sine = _row(part, "cosine"), _row(part, "sine")
    turn = 2 * np.pi * math.fmod(_number(part, "turns") * float(state["samples"][0]), 1.0)
    angle = turn * np.arange(1, len(cosine) + 1)
    return float(cosine @ np.cos(angle) + sine @ np.sin(angle)), None


def _auxiliary(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    lagged, own = _output_lag(part, state, value)
    return _number(part, "gain") * lagged, own


def _reptation(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    reach, gain, last = _row(part, "reach"), _row(part, "gain"), float(state["input"][0])
    play, leaky = np.split(state[part.name], 2)
    if not state["started"][0]:
        play, leaky, last = np.full(len(gain), value), np.full(len(gain), value), value
    way = value - last
    travel = abs(way) / _number(part, "path")
    trail = way * -math.expm1(-travel) / travel if travel > 0 else way
    play = np.clip(play, value - reach, value + reach)
    leaky = value - trail + math.exp(-travel) * (leaky - last)
    leaky = np.clip(leaky, value - reach, value + reach)
    return float(gain @ (leaky - play)), np.concatenate([play, leaky])


def _operator_creep(part: Part, state: State, value: float) -> tuple[float, np.ndarray]:
    gain, tau, threshold = (_row(part, name) for name in ("gain", "tau", "threshold"))
    place = np.full(len(gain), value)
    if state["started"][0]:
        last = float(state["input"][0])
        pairs = [(r, t) for r in threshold.tolist() for t in tau.tolist()]
        places = zip(state[part.name].tolist(), pairs, strict=True)
        place = np.array([_pulled(each, last, value, r, t) for each, (r, t) in places])
    return float(gain @ place), place


def _pulled(place: float, before: float, now: float, threshold: float, tau: float) -> float:
    """A creep operator after one sample in which its input goes straight; `tau` in samples."""
    slope, distance = now - before, before - place
    lag = slope * tau
    ahead = distance - min(max(distance, -threshold), threshold)
    until = 1.0 if ahead else 0.0
    if ahead * lag < 0:
        until = min(-tau * math.log(lag / (lag - ahead)), 1.0)
    if until > 0:
        place += slope * until + (lag - ahead) * math.expm1(-until / tau)
    if slope:
        gap = math.copysign(1.0, slope) * (place - before - slope * until) + threshold
        left = 1 - until - max(gap / abs(slope), 0.0)
        if left > 0:
            place += slope * left + lag * math.expm1(-left / tau)
    return place


def _mapped(part: Part, signal: float) -> float:
    """The reading of the sensor, by halving."""
    low_z, range_z = _number(part, "low"), _number(part, "range")
    quadratic, cubic = _row(part, "cubic")
    ripples = _row(part, "ripples")

    def unread(reading: float) -> float:
        x = 2 * (reading - low_z) / range_z - 1
        end = min(max(x, -1.0), 1.0)
        bent = quadratic * ((3 * end**2 - 1) / 2 + 3 * end * (x - end))
        bent += cubic * ((5 * end**3 - 3 * end) / 2 + (15 * end**2 - 3) / 2 * (x - end))
        waves = np.cos(np.arange(2, len(ripples) + 2) * np.pi * (end + 1) / 2)
        return reading - float(bent + ripples @ waves)

    reach = 2 * abs(unread(signal) - signal)
    for _ in range(6):
        if unread(signal - reach) <= signal <= unread(signal + reach):
            break
        reach *= 2
    low, high = signal - reach, signal + reach
    for _ in range(_MAP_ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if unread(middle) < signal else (low, middle)
    return 0.5 * (low + high)


_OUTPUT: dict[str, Callable[[Part, State, float], tuple[float, np.ndarray]]] = {
    "creep": _creep,
    "output_lag": _output_lag,
    "delay": _delay,
    "resonance": _resonance,
}
_ADDED: dict[str, Callable[[Part, State, float], tuple[float, np.ndarray | None]]] = {
    "drift": _drift,
    "hum": _hum,
    "auxiliary": _auxiliary,
    "reptation": _reptation,
    "operator_creep": _operator_creep,
}
