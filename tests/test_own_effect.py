"""A user's effect of some twenty lines is fitted, found, and cannot harm the others."""

import math
import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import world
from blind import hidden

import preisach_jax as pj
from preisach_jax.effects import BUILT_IN
from preisach_jax.effects.base import Survey
from preisach_jax.effects.lawful import require_law_of_place

RATE = 500.0
UNITS = {"input": "V", "output": "um"}


class SensorLag(pj.OutputEffect):
    """A sensor with a first-order low-pass: tau y' = h - y."""

    name = "sensor_lag"
    physics = "The sensor's electronics averages."
    source = "its data sheet"
    signature = "residual in proportion to the rate of the output"
    experiment = "a chirp: the gain falls with frequency"

    tau_s: float = pj.parameter("s", 1e-4, 1.0, start=(3e-3, 0.03, 0.3), log=True)

    def init(self, first):
        return first, first

    def step(self, state, value, dt):
        before, y = state
        share = -jnp.expm1(-dt / self.tau_s)
        y = y + share * ((before + value) / 2 - y)
        return (value, y), y


class Mains(pj.AddedEffect):
    """Pick-up of the mains: one line of known frequency, any phase."""

    name = "mains"
    f_hz: float = 60.0

    def coefficients(self):
        return tuple(pj.Parameter(name, "{z}", -jnp.inf, jnp.inf) for name in ("cosine", "sine"))

    def columns(self, signals):
        phase = 2 * jnp.pi * self.f_hz * signals.time
        return jnp.stack([jnp.cos(phase), jnp.sin(phase)], axis=1)


def stage(change=lambda h: h, effect=None):
    """A record of the simulated actuator, its output changed by NumPy and SciPy alone."""
    rec = world.hidden_record(effect, 4, duration_s=6.0, rate_hz=RATE)
    output = change(rec["clean"]) + 0.01 * np.random.default_rng(4).normal(size=len(rec["t"]))
    return rec, pj.Record.from_arrays(rec["t"], rec["x"], output, units=UNITS, initial_memory="low")


@pytest.fixture(scope="module")
def lagging():
    return stage(lambda h: hidden.lag(h, 0.02, 1 / RATE))[1]


@pytest.fixture(scope="module")
def plain():
    return stage()[1]


def test_it_is_found_fitted_and_saved_like_one_of_the_library(lagging, tmp_path):
    found = pj.diagnose(lagging, [SensorLag(), Mains()], levels=9)
    assert found.effects == ("sensor_lag",)
    estimate = found.findings[0].parameters["tau_s"]
    assert estimate.value == pytest.approx(0.02, rel=0.01)
    assert estimate.unit == "s"
    assert estimate.low < estimate.value < estimate.high
    assert all(c.why_not for c in found.candidates if c.effect != "sensor_lag")
    assert "sensor_lag" in found.sentence
    assert "sensor_lag.tau_s" in found.final.summary()
    found.model.save(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json", effects=[SensorLag()])
    expected = found.model.predict(lagging).output
    np.testing.assert_array_equal(again.predict(lagging).output, expected)


def test_an_effect_without_parameters_is_fitted_and_saved_with_its_settings(tmp_path):
    t = np.arange(6 * int(RATE)) / RATE
    _, record = stage(lambda h: h + 0.2 * np.sin(2 * np.pi * 50.0 * t + 0.7))
    model = pj.fit(record, [Mains(f_hz=50.0)], levels=9).model
    parts = [model.parameters["mains"][name].value for name in ("cosine", "sine")]
    assert math.hypot(*parts) == pytest.approx(0.2, rel=0.05)
    phase = np.arctan2(parts[0], parts[1])  # of a sine
    assert np.angle(np.exp(1j * (phase - 0.7))) == pytest.approx(0, abs=0.05)
    model.save(tmp_path / "model.json")
    with pytest.raises(pj.InputError, match=r"'mains'.*Model.load\(path, effects="):
        pj.Model.load(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json", effects=[Mains()])
    assert again.effects[0].settings() == {"f_hz": 50.0}


# --- effects with mistakes in them ---


def own(name, place: Any = pj.InputEffect, **methods):
    """An effect with a parameter a, and with methods that are not those it should have."""
    a = pj.parameter("1/{z}", -0.02, 0.02, start=(0.01,))
    fields = {"name": name, "a": a, "__annotations__": {"a": float}}
    return type(place)(name, (place,), fields | methods)()


def failing(error):
    def method(*_):
        raise error

    return method


RAISING = own("raising", apply=failing(KeyError("my table")))
TOO_LONG = own("too_long", apply=lambda self, signal, time: jnp.append(signal, signal[-1]))


def one_gain(self):
    return (pj.coefficient("gain", "{z}"),)


MISTAKES = (
    (RAISING, "failed: KeyError: 'my table'"),
    (own("dividing", apply=lambda self, signal, time: signal / 0), "could not .*not finite"),
    (TOO_LONG, r"failed: EffectError: .*the shape \(3001,\) from apply.*return \(3000,\)"),
    (own("flat", pj.AddedEffect, coefficients=one_gain, columns=lambda self, s: s.time),
        r"failed: EffectError: .*the shape \(3000,\) from columns.*\(3000, 1\)"),
    (own("scalar", pj.WeightEffect, factor=lambda self, signals: 1 - self.a),
        r"failed: EffectError: .*'scalar' returns the shape \(\) from factor"),
    (own("unfinished", pj.OutputEffect), r"failed: EffectError: .*: write init\(self, first\)"),
    (own("homeless", pj.Effect), "failed: EffectError: .*derive it from InputEffect"),
    (own("unbounded", bound_to=failing(ZeroDivisionError("no span"))),
        "failed: ZeroDivisionError: no span"),
)  # fmt: skip


def test_each_mistake_is_a_candidate_that_failed_and_the_diagnosis_goes_on():
    _, record = stage(effect="drift")
    found = pj.diagnose(record, [*(effect for effect, _ in MISTAKES), "drift"], levels=5)
    assert found.effects == ("drift",)
    for effect, says in MISTAKES:
        candidates = [c for c in found.candidates if c.effect == effect.name]
        assert candidates
        for candidate in candidates:
            assert not candidate.accepted
            assert re.match(says, candidate.why_not, flags=re.DOTALL), candidate.why_not


def acting(name, step):
    return own(name, pj.OutputEffect, init=lambda self, first: 0 * first, step=step)


def slowing(self, state, value, dt):
    state = state + 0.1 * jnp.tanh(self.a * (value - state))
    return state, state


class Branching(SensorLag):
    name = "branching"

    def step(self, state, value, dt):
        if value > 0:
            return super().step(state, value, dt)
        return state, value


BRANCHES = r"'branching' branches on .*line \d+: if value > 0:.*jnp.where\(condition"
REMEMBERS = {"coefficients": one_gain, "columns": lambda self, h: jnp.cumsum(h)[:, None]}


@pytest.mark.parametrize(
    ("effect", "says"),
    [
        (TOO_LONG, r"the shape \(3001,\) from apply; make it return \(3000,\)"),
        # What breaks the law of its place is told another one.
        (acting("bent", lambda self, state, value, dt: (state, value + self.a * value**2)),
            r"'bent' is an OutputEffect, but not linear.*derive it from pj.SensorEffect"),
        (acting("slowing", slowing),
            r"'slowing' .*not linear.*belongs before the hysteresis \(pj.InputEffect\)"),
        (acting("shifted", lambda self, state, value, dt: (state, value + self.a)),
            r"'shifted' .*not linear.*columns of a pj.AddedEffect"),
        (own("remembering", pj.SensorEffect, **REMEMBERS),
            r"'remembering' is a SensorEffect.*other samples.*pj.OutputEffect"),
        # What cannot be traced is told with its line.
        (Branching(), BRANCHES),
        (acting("rooted", lambda self, state, value, dt: (state, math.sqrt(value))),
            r"'rooted' makes a Python number.*jax.numpy"),
    ],
    ids=lambda value: getattr(value, "name", ""),
)  # fmt: skip
def test_a_mistake_in_a_fit_is_told_as_the_users(plain, effect, says):
    with pytest.raises(pj.InputError, match=says):
        pj.fit(plain, [effect], levels=5)


def test_an_error_of_the_users_own_code_is_the_users_to_see(plain):
    with pytest.raises(KeyError, match="my table"):
        pj.fit(plain, [RAISING], levels=5)
    with pytest.raises(pj.InputError, match=BRANCHES):
        Branching(tau_s=0.1).apply(jnp.arange(5.0), jnp.arange(5.0))


BOUND_BY_A_LAW = [k for k in BUILT_IN if issubclass(k, pj.OutputEffect | pj.SensorEffect)]


@pytest.mark.parametrize("kind", BOUND_BY_A_LAW, ids=lambda kind: kind.__name__)
def test_the_library_keeps_the_laws_of_its_places(x64, kind):
    t = np.arange(2000) / 100
    u = 5 - 5 * np.cos(t * (1 + t / 40))
    survey = Survey(20.0, 0.01, t, u, u**1.1, 0.1 * np.sin(7 * t), {"load_N": np.cos(t)})
    for form in kind().variants(survey):
        require_law_of_place(form, survey)


# --- an effect that makes things worse ---


class Chance(pj.AddedEffect):
    """Forty columns of noise, of which the rows that identify will like some."""

    name = "chance"

    def coefficients(self):
        return tuple(pj.coefficient(f"c{k}", "{z}") for k in range(40))

    def columns(self, signals):
        return jax.random.normal(jax.random.key(0), (len(signals.time), 40))


def test_an_effect_that_raises_the_held_out_error_is_told():
    _, record = stage(effect="drift")
    few = pj.Record.from_arrays(
        record.time[::6], record.input[::6], record.output[::6], units=UNITS, initial_memory="low"
    )
    plain = pj.fit(few, levels=5)
    found = pj.fit(few, ["drift", Chance()], levels=5)
    assert [each.effects for each in found.added] == [("drift",), ("chance",)]
    assert found.added[0].before == pytest.approx(plain.rms_validation, rel=0.02)
    assert found.added[1].after == pytest.approx(found.rms_validation, rel=0.02)
    assert found.added[1].before < found.added[1].after < found.added[0].before
    (sentence,) = found.rises
    assert "adding chance raised the held-out error" in sentence
    assert f"warning: {sentence}" in found.summary()
    assert plain.rises == pj.fit(few, ["drift"], levels=5).rises == ()


# --- what is given in place of an effect ---


@pytest.mark.parametrize("use", [pj.fit, pj.diagnose, pj.explore])
def test_what_is_no_list_of_effects_is_told(plain, use):
    for asked, says in (
        ("creep", r"effects is 'creep': give a list"),
        (SensorLag(), r"effects is SensorLag.*: give a list"),
        ([SensorLag], r"holds the class SensorLag: give an effect, SensorLag\(\)"),
        ([None], r"effects holds None"),
        (["creep", own("creep")], "'creep' is asked for twice"),
    ):
        with pytest.raises(pj.InputError, match=says):
            use(plain, asked)


def test_a_unit_that_lacks_and_a_parameter_that_is_none_are_told():
    with pytest.raises(pj.InputError, match=r"coefficient\('um'\) has a name and no unit"):
        pj.coefficient("um")
    with pytest.raises(pj.InputError, match="no parameter 'tau'; give values of tau_s"):
        SensorLag().at({"tau": 1.0})
    # An effect can be looked at with a value of its parameter.
    time = jnp.arange(5.0)
    late = time - SensorLag(tau_s=0.01).apply(time, time)
    assert float(late[-1]) == pytest.approx(0.5, abs=0.02)
