"""What the excitation of a record can tell is asked before an effect is named."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.diagnosis.lines import _heights
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.tellable import InputSurvey, untellable
from preisach_jax.effects import resolve
from preisach_jax.effects.base import CYCLES, RATES
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.reptation import Reptation
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.viscosity import Viscosity
from preisach_jax.look.stretches import Period

TIME = np.arange(0.0, 20.0, 0.005)


def triangle(phase):
    """A triangle from 0 to 1 of period 1."""
    return np.abs((phase + 0.5) % 1.0 - 0.5) * 2


INPUTS = {
    "a triangle of one rate": (triangle(TIME / 2), False, True),
    "a sine of one height": (np.sin(2 * np.pi * TIME / 2), False, True),
    "the same with noise": (
        np.sin(np.pi * TIME) + 0.003 * np.random.default_rng(1).normal(size=len(TIME)),
        False,
        True,
    ),
    "a triangle of two rates": (
        np.where(TIME < 10, triangle(TIME / 2), triangle(TIME / 0.5)),
        True,
        True,
    ),
    "sines of two heights": (np.sin(np.pi * TIME) * np.where(TIME < 10, 1.0, 0.6), True, True),
    "a triangle that rests": (triangle(np.minimum(TIME % 4, 2.5) / 2.5), True, True),
    "one cycle": (triangle(TIME / 20), False, False),
    "one way": (TIME, False, False),
}


@pytest.mark.parametrize("name", INPUTS)
def test_rates_and_cycles_of_an_input(name):
    values, rates, cycles = INPUTS[name]
    survey = InputSurvey(TIME, values)
    assert (survey.shows(RATES), survey.shows(CYCLES)) == (rates, cycles)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_neither_units_nor_origins_count(scale):
    for values, rates, cycles in INPUTS.values():
        survey = InputSurvey(3.0 + TIME * 1e-3, scale * (values - 5.0))
        assert (survey.shows(RATES), survey.shows(CYCLES)) == (rates, cycles)


def test_a_need_that_does_not_exist_is_told():
    with pytest.raises(ValueError, match="'heights' is no need"):
        InputSurvey(TIME, TIME).shows("heights")


def test_a_constant_input_shows_nothing():
    survey = InputSurvey(TIME, np.ones_like(TIME))
    assert not survey.shows(RATES)
    assert not survey.shows(CYCLES)


def test_lines_of_a_periodic_drive_and_what_they_make():
    survey = InputSurvey(TIME, np.sin(2 * np.pi * 0.5 * TIME))
    assert survey.lines_hz == pytest.approx((0.5,), rel=0.01)
    assert survey.makes(1.5)  # a harmonic
    assert not survey.makes(50.0)  # far beyond the harmonics that count
    assert not survey.makes(1.25)
    two = InputSurvey(TIME, np.sin(2 * np.pi * 1.3 * TIME) + np.sin(2 * np.pi * 8.2 * TIME))
    assert sorted(two.lines_hz)[-2:] == pytest.approx([1.3, 8.2], abs=1 / 20)
    assert two.makes(8.2 + 2 * 1.3)
    assert not two.makes(40.0)


def test_a_drive_of_many_rates_has_no_lines():
    assert InputSurvey(TIME, np.sin(TIME**2)).lines_hz == ()


def numbers_of(*effects):
    return [(effect.name, each) for effect in effects for each in effect.coefficients()]


def stand_in(
    effect, values, input_of_time, residual=0 * TIME, lines=(1.0, 0.0)
) -> tuple[Any, Any, str]:
    problem = SimpleNamespace(
        cache={("input survey",): InputSurvey(TIME, input_of_time)},
        record=SimpleNamespace(time=TIME),
        rows=np.arange(len(TIME)),
        survey=SimpleNamespace(step_s=0.005),
        shown_unit=lambda unit: unit.replace("{u}", "V"),
    )
    point = SimpleNamespace(
        chain=SimpleNamespace(
            effects=(effect,), effect=lambda name: effect, coefficients=numbers_of(effect)
        ),
        values={effect.name: values},
        residual=residual / 2,
        unit=2.0,
        coefficients=lambda: SimpleNamespace(added=np.array(lines)),
    )
    return problem, point, effect.name


def test_a_hum_at_the_drives_own_lines_is_none():
    drive = np.sin(2 * np.pi * 0.5 * TIME)
    assert "multiples of the drive" in implausible(*stand_in(Hum(), {"f_hz": 1.0}, drive))
    assert implausible(*stand_in(Hum(harmonics=1), {"f_hz": 50.0}, drive)) == ""


def test_a_drift_faster_than_the_drive_is_none():
    slow, fast = triangle(TIME / 5), triangle(TIME / 0.5)
    wander = Drift(horizon_s=20.0, waves=24)
    assert "faster than the drive" in implausible(*stand_in(wander, {}, slow))
    assert implausible(*stand_in(wander, {}, fast)) == ""


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"f_hz": 100.0, "zeta": 0.69}, "zeta of 0.69 1 lies at the upper bound"),
        ({"f_hz": 1.01, "zeta": 0.02}, "f_hz of 1.01 Hz lies at the lower bound"),
        ({"f_hz": 100.0, "zeta": 0.02}, ""),
    ],
)
def test_a_parameter_at_a_bound_of_the_search_is_no_finding(values, said):
    told = implausible(*stand_in(Resonance(), values, np.sin(TIME**2)))
    assert said in told
    assert bool(said) == bool(told)


@pytest.mark.parametrize(
    ("tau_s", "said"), [(0.005, ""), (0.1, ""), (5.0, "goes with where the input is")]
)
def test_a_speed_so_late_that_it_is_a_place_is_no_viscosity(tau_s, said):
    """Sines of 0.3 to 2 Hz pass a smoothing over 5 s as what they are, and not as their rates."""
    drive = np.sin(2 * np.pi * 0.3 * TIME) + 0.5 * np.sin(2 * np.pi * 2.0 * TIME + 1)
    told = implausible(*stand_in(Viscosity(), {"tau_s": tau_s}, drive))
    assert said in told
    assert bool(said) == bool(told)


@pytest.mark.parametrize(
    ("path", "said"), [(0.3, "path of 0.3 V lies at the lower bound"), (1.0, ""), (30.0, "")]
)
def test_what_is_forgotten_at_once_is_no_reptation(path, said):
    told = implausible(*stand_in(Reptation(), {"path": path}, np.sin(TIME**2)))
    assert said in told
    assert bool(said) == bool(told)


def test_a_drift_at_its_bound_is_a_straight_line():
    drift = Drift(horizon_s=20.0)
    values = {"tau_s": 30 * 20.0}
    assert implausible(*stand_in(drift, values, np.sin(TIME**2))) == ""


@pytest.mark.parametrize("name", ["creep", "input_lag", "output_lag", "delay", "resonance"])
def test_what_depends_on_the_rate_cannot_be_told_at_one_rate(name):
    problem, *_ = stand_in(Resonance(), {}, INPUTS["a triangle of one rate"][0])
    (effect,) = resolve((name,), {})
    assert "one rate" in untellable(problem, effect)
    problem, *_ = stand_in(Resonance(), {}, INPUTS["a triangle of two rates"][0])
    assert untellable(problem, effect) == ""


def test_at_one_rate_nothing_dynamic_is_named():
    made = world.hidden_record("creep", 7, 12.0, 500.0, excitation="poor")
    record = pj.Record.from_arrays(made["t"], made["x"], made["z"])
    found = pj.diagnose(record, ["creep", "input_lag", "output_lag"], levels=9)
    assert found.effects == ()
    assert all("one rate only" in candidate.why_not for candidate in found.candidates)
    assert any("one rate" in note for note in found.notes)


@pytest.mark.parametrize(
    ("f_hz", "height", "said"),
    [
        (50.0, 0.004, "a multiple of the drive's"),  # one of the drive's 100th multiples
        (50.0, 0.02, ""),  # stands out of the others
        (50.22, 0.004, ""),  # between two multiples
    ],
)
def test_a_hum_that_is_a_tooth_of_the_drives_comb_is_none(f_hz, height, said):
    drive = triangle(TIME / 2)
    rng = np.random.default_rng(3)
    combs = [f / 2 for f in range(85, 116) if f != 100]
    waves = [np.cos(2 * np.pi * (f * TIME + rng.uniform())) for f in combs]
    teeth = 0.001 * np.sum(waves, axis=0)
    lines = (0.6 * height, 0.8 * height)
    told = implausible(*stand_in(Hum(harmonics=1), {"f_hz": f_hz}, drive, teeth, lines))
    assert said in told
    assert bool(said) == bool(told)


@pytest.mark.parametrize(
    ("f_hz", "height", "bits", "said"),
    [
        (69.6, 0.0004, 10, "steps of the input's converter"),
        (69.6, 0.004, 10, ""),  # far higher than the steps make it
        (50.0, 0.0004, 10, ""),  # elsewhere
        (69.6, 0.0004, 24, ""),  # steps that make nothing
    ],
)
def test_a_hum_that_the_steps_of_the_recorded_input_make_is_none(f_hz, height, bits, said):
    """A ramp that passes 130.4 steps a second: samples at 200 Hz fold its line to 69.6 Hz."""
    step = 0.1 / 130.4 * 2.0 ** (10 - bits)
    recorded = np.round(triangle(TIME / 20) / step) * step
    lines = (0.6 * height, 0.8 * height)
    told = implausible(*stand_in(Hum(harmonics=1), {"f_hz": f_hz}, recorded, lines=lines))
    assert said in told
    assert bool(said) == bool(told)


def test_the_period_of_a_drive_is_told_from_many_of_it():
    period = Period.of(TIME, np.sin(2 * np.pi * TIME / 0.61234))
    assert period is not None
    assert period.seconds == pytest.approx(0.61234, rel=period.spread)
    assert period.spread < 6e-4
    assert period.has_multiple(200 / 0.61234, 20.0)
    assert not period.has_multiple(200.3 / 0.61234, 20.0)
    assert Period.of(TIME, np.sin(TIME**2)) is None


def test_lines_of_a_hum_are_read_behind_what_is_added_before_it():
    hum, drift = Hum(harmonics=2), Drift(horizon_s=20.0)
    before = [7.0] * len(drift.coefficients())
    lines = (*before, 0.3, 0.4, 5.0, 12.0)
    _, point, _ = stand_in(hum, {"f_hz": 50.0}, TIME, lines=lines)
    point.chain.coefficients = numbers_of(drift, hum)
    np.testing.assert_allclose(_heights(point, hum), [0.5, 13.0])
