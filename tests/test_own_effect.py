"""A user's effect of some twenty lines is fitted, found, and cannot harm the others."""

import math
import re

import jax.numpy as jnp
import numpy as np
import pytest
import world

import preisach_jax as pj

RATE = 1000.0
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

    def coefficients(self):
        return tuple(pj.Parameter(name, "{z}", -jnp.inf, jnp.inf) for name in ("cosine", "sine"))

    def columns(self, signals):
        phase = 2 * jnp.pi * 50.0 * signals.time
        return jnp.stack([jnp.cos(phase), jnp.sin(phase)], axis=1)


def stage(change=lambda h: h, seed=4, noise=0.01, effect=None):
    """A record of the simulated actuator, its output changed by NumPy and SciPy alone."""
    rec = world.hidden_record(effect, seed, duration_s=6.0, rate_hz=RATE, noise_um=0.0)
    rng = np.random.default_rng(seed)
    output = change(rec["clean"]) + noise * rng.normal(size=len(rec["t"]))
    return rec, pj.Record.from_arrays(rec["t"], rec["x"], output, units=UNITS, initial_memory="low")


def lagging(tau):
    return stage(lambda h: world.ramp_lag(h, tau, 1 / RATE))[1]


def test_it_is_fitted_like_one_of_the_library():
    record = lagging(0.02)
    base, found = pj.fit(record, levels=9), pj.fit(record, [SensorLag()], levels=9)
    estimate = found.model.parameters["sensor_lag"]["tau_s"]
    assert estimate.value == pytest.approx(0.02, rel=0.01)
    assert estimate.unit == "s"
    assert estimate.low < estimate.value < estimate.high
    assert found.rms_validation < 0.2 * base.rms_validation
    assert found.effects == ("sensor_lag",)
    assert "sensor_lag.tau_s" in found.summary()


def test_it_is_found_beside_the_library(tmp_path):
    found = pj.diagnose(lagging(0.02), [SensorLag(), "drift", "delay"], levels=9)
    assert found.effects == ("sensor_lag",)
    assert found.verdict == "explained"
    parameters = found.findings[0].parameters
    assert parameters["tau_s"].value == pytest.approx(0.02, rel=0.01)
    assert {c.effect for c in found.candidates} >= {"sensor_lag", "drift", "delay"}
    assert "sensor_lag" in found.sentence
    found.model.save(tmp_path / "model.json")
    again = pj.Model.load(tmp_path / "model.json", effects=[SensorLag()])
    record = lagging(0.02)
    np.testing.assert_array_equal(again.predict(record).output, found.model.predict(record).output)


def test_it_is_not_found_where_it_is_not():
    found = pj.diagnose(stage()[1], [SensorLag(), Mains()], levels=11)
    assert found.effects == ()
    assert all(candidate.why_not for candidate in found.candidates)


def test_an_effect_without_parameters_is_found():
    rec, record = stage(effect="hum")
    found = pj.diagnose(record, ["drift", Mains()], levels=11)
    assert found.effects == ("mains",)
    parts = [found.findings[0].parameters[name].value for name in ("cosine", "sine")]
    assert math.hypot(*parts) == pytest.approx(rec["truth"]["amplitude_um"], rel=0.05)
    phase = np.arctan2(parts[0], parts[1])  # of a sine
    assert np.angle(np.exp(1j * (phase - rec["truth"]["phase"]))) == pytest.approx(0, abs=0.05)


# --- effects with mistakes in them ---


class Mistaken(pj.InputEffect):
    a: float = pj.parameter("1", 0.0, 1.0, start=(0.5,))


class Raising(Mistaken):
    name = "raising"

    def apply(self, signal, time):
        raise KeyError("my table")


class Dividing(Mistaken):
    name = "dividing"

    def apply(self, signal, time):
        return signal / (time - time)


class TooLong(Mistaken):
    name = "too_long"

    def apply(self, signal, time):
        return jnp.append(signal, signal[-1])


class OneNumber(Mistaken):
    name = "one_number"

    def apply(self, signal, time):
        return jnp.mean(signal)


class Flat(pj.AddedEffect):
    name = "flat"

    def coefficients(self):
        return (pj.Parameter("gain", "{z}", -jnp.inf, jnp.inf),)

    def columns(self, signals):
        return signals.time


class Scalar(pj.WeightEffect):
    name = "scalar"

    a: float = pj.parameter("1", 0.0, 1.0)

    def factor(self, signals):
        return 1 - self.a


class Unfinished(pj.OutputEffect):
    name = "unfinished"


class Homeless(pj.Effect):
    name = "homeless"


class Unbounded(Mistaken):
    name = "unbounded"

    def bound_to(self, span):
        raise ZeroDivisionError("no span")


MISTAKES = {
    "raising": "failed: KeyError: 'my table'",
    "dividing": "could not be fitted: .*not finite",
    "too_long": r"failed: EffectError: .*'too_long' returns the shape \(6001,\).*return \(6000,\)",
    "one_number": r"failed: EffectError: .*'one_number' returns the shape \(\)",
    "flat": r"failed: EffectError: .*'flat' returns the shape \(6000,\) from columns.*\(6000, 1\)",
    "scalar": r"failed: EffectError: .*'scalar' returns the shape \(\) from factor",
    "unfinished": r"failed: EffectError: .*lacks a method of its place: write init\(self, first\)",
    "homeless": "failed: EffectError: .*derive it from InputEffect",
    "unbounded": "failed: ZeroDivisionError: no span",
}


@pytest.fixture(scope="module")
def despite_mistakes():
    kinds = (
        Raising,
        Dividing,
        TooLong,
        OneNumber,
        Flat,
        Scalar,
        Unfinished,
        Homeless,
        Unbounded,
    )
    _, record = stage(effect="drift")
    return pj.diagnose(record, [*(kind() for kind in kinds), "drift"], levels=7)


def test_the_diagnosis_goes_on_without_them(despite_mistakes):
    assert despite_mistakes.effects == ("drift",)
    json = despite_mistakes.to_json()
    assert {c["effect"] for c in json["candidates"]} == {*MISTAKES, "drift"}
    assert despite_mistakes.summary()


@pytest.mark.parametrize(("effect", "says"), MISTAKES.items())
def test_each_mistake_is_reported_as_a_candidate_that_failed(despite_mistakes, effect, says):
    candidates = [c for c in despite_mistakes.candidates if c.effect == effect]
    assert candidates
    for candidate in candidates:
        assert not candidate.accepted
        assert re.match(says, candidate.why_not, flags=re.DOTALL), candidate.why_not


def test_a_mistake_in_a_fit_is_the_users_to_see():
    with pytest.raises(KeyError, match="my table"):
        pj.fit(stage()[1], [Raising()], levels=5)


@pytest.mark.parametrize(
    ("effect", "says"),
    [
        (TooLong(), r"returns the shape \(6001,\) from apply; make it return \(6000,\)"),
        (Unfinished(), r"lacks a method of its place: write init\(self, first\)"),
        (Homeless(), "derive it from InputEffect"),
    ],
)
def test_a_mistake_in_the_class_is_told_as_the_users_and_not_as_ours(effect, says):
    with pytest.raises(pj.InputError, match=says):
        pj.fit(stage()[1], [effect], levels=5)


def test_bounds_of_a_parameter_in_the_wrong_order_are_the_users_mistake():
    with pytest.raises(pj.InputError, match=r"'a' has bounds 2.0 and 1.0"):
        pj.Parameter("a", "1", 2.0, 1.0)


def test_a_parameter_that_an_effect_does_not_have_is_told():
    with pytest.raises(pj.InputError, match="no parameter 'tau'; give values of tau_s"):
        SensorLag().at({"tau": 1.0})


def test_an_effect_can_be_looked_at_with_a_value_of_its_parameter():
    time = jnp.arange(5.0)
    late = time - SensorLag(tau_s=0.01).apply(time, time)
    assert float(late[-1]) == pytest.approx(0.5, abs=0.02)


def test_a_name_of_the_library_cannot_be_taken():
    class Creep(SensorLag):
        name = "creep"

    with pytest.raises(pj.InputError, match="'creep' is asked for twice"):
        pj.diagnose(stage()[1], ["creep", Creep()])
