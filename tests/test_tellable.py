"""What the excitation of a record can tell is asked before an effect is named."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from found import LEVELS, ROWS
from test_modes import plays

import preisach_jax as pj
from preisach_jax.diagnosis.plausible import implausible
from preisach_jax.diagnosis.tellable import InputSurvey, untellable
from preisach_jax.effects import resolve
from preisach_jax.effects.base import CYCLES, HEIGHTS, RATES
from preisach_jax.effects.drift import Drift
from preisach_jax.effects.hum import Hum
from preisach_jax.effects.reptation import Reptation
from preisach_jax.effects.resonance import Resonance
from preisach_jax.effects.viscosity import Viscosity
from preisach_jax.look.stretches import Period

TIME = np.arange(0.0, 20.0, 0.005)
NOISE = 0.003 * np.random.default_rng(1).normal(size=len(TIME))


def triangle(phase):
    """A triangle from 0 to 1 of period 1."""
    return np.abs((phase + 0.5) % 1.0 - 0.5) * 2


SLOW, FAST, CHIRP = triangle(TIME / 2), triangle(TIME / 0.5), np.sin(TIME**2)
INPUTS = {
    "a triangle of one rate": (SLOW, False, True, False),
    "a noisy sine of one height": (np.sin(np.pi * TIME) + NOISE, False, True, False),
    "a triangle of two rates": (np.where(TIME < 10, SLOW, FAST), True, True, False),
    "sines of two heights": (
        np.sin(np.pi * TIME) * np.where(TIME < 10, 1.0, 0.6), True, True, True
    ),
    "a triangle that rests": (triangle(np.minimum(TIME % 4, 2.5) / 2.5), True, True, False),
    "one cycle": (triangle(TIME / 20), False, False, False),
    "one way": (TIME, False, False, False),
    "a constant": (np.ones_like(TIME), False, False, False),
}  # fmt: skip


@pytest.mark.parametrize("name", INPUTS)
def test_rates_cycles_and_heights_of_an_input_whatever_its_units(name):
    values, *shown = INPUTS[name]
    for time, scaled in ((TIME, values), (3 + TIME * 1e-3, 1e9 * (values - 5.0))):
        survey = InputSurvey(time, scaled)
        assert [survey.shows(need) for need in (RATES, CYCLES, HEIGHTS)] == shown
    with pytest.raises(ValueError, match="'depths' is no need"):
        survey.shows("depths")


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
    assert InputSurvey(TIME, CHIRP).lines_hz == ()


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


PLACES = np.sin(0.6 * np.pi * TIME) + 0.5 * np.sin(4 * np.pi * TIME + 1)


@pytest.mark.parametrize(
    ("effect", "values", "drive", "said"),
    [
        (Hum(), {"f_hz": 1.0}, np.sin(np.pi * TIME), "multiples of the drive"),
        (Hum(harmonics=1), {"f_hz": 50.0}, np.sin(np.pi * TIME), ""),
        (Drift(horizon_s=20.0), {"tau_s": 600.0}, CHIRP, ""),  # at its bound: a straight line
        (Resonance(), {"f_hz": 100.0, "zeta": 0.69}, CHIRP, "zeta of 0.69 1 lies at the upper"),
        (Resonance(), {"f_hz": 1.01, "zeta": 0.02}, CHIRP, "f_hz of 1.01 Hz lies at the lower"),
        (Resonance(), {"f_hz": 100.0, "zeta": 0.02}, CHIRP, ""),
        (Viscosity(), {"tau_s": 0.1}, PLACES, ""),
        # A smoothing over 5 s passes these sines as what they are, and not as their rates.
        (Viscosity(), {"tau_s": 5.0}, PLACES, "goes with where the input is"),
        (Reptation(), {"path": 0.3}, CHIRP, "path of 0.3 V lies at the lower bound"),
        (Reptation(), {"path": 30.0}, CHIRP, ""),
    ],
)
def test_what_the_drive_or_a_bound_makes_is_no_finding(effect, values, drive, said):
    told = implausible(*stand_in(effect, values, drive))
    assert said in told
    assert bool(said) == bool(told)


def test_what_depends_on_the_rate_cannot_be_told_at_one_rate():
    rates = ("a triangle of one rate", "a triangle of two rates")
    for effect in resolve(("creep", "input_lag", "output_lag", "delay", "resonance"), {}):
        one, two = (stand_in(Resonance(), {}, INPUTS[name][0])[0] for name in rates)
        assert "one rate" in untellable(one, effect)
        assert untellable(two, effect) == ""


def test_at_one_rate_nothing_dynamic_is_named():
    time = np.arange(ROWS) / 500
    u = 10 * triangle(time / 0.7)
    late = plays(u) + np.random.default_rng(1).normal(0, 0.01, ROWS) + 0.3 * np.roll(plays(u), 9)
    record = pj.Record.from_arrays(time, u, late)
    found = pj.diagnose(record, ["creep", "input_lag", "output_lag", "delay"], levels=LEVELS)
    assert found.effects == ()
    assert all("one rate only" in candidate.why_not for candidate in found.candidates)
    assert any("one rate" in note for note in found.notes)
    late += 0.5 * np.sin(2 * np.pi * 3.3 * time)
    record = pj.Record.from_arrays(time, u, late)
    found = pj.diagnose(record, ["creep", "input_lag", "output_lag"], levels=LEVELS)
    assert found.verdict == "unexplained"
    assert "this record can show none of the effects that were asked for" in found.sentence


def stairs(bits):
    """A ramp that passes 130.4 steps a second: samples at 200 Hz fold its line to 69.6 Hz."""
    step = 0.1 / 130.4 * 2.0 ** (10 - bits)
    return np.round(triangle(TIME / 20) / step) * step


@pytest.mark.parametrize(
    ("f_hz", "height", "drive", "said"),
    [
        (50.0, 0.004, SLOW, "a multiple of the drive's"),  # one of the drive's 100th multiples
        (50.0, 0.02, SLOW, ""),  # stands out of the others
        (50.22, 0.004, SLOW, ""),  # between two multiples
        (69.6, 0.0004, stairs(10), "steps of the input's converter"),
        (69.6, 0.004, stairs(10), ""),  # far higher than the steps make it
        (69.6, 0.0004, stairs(24), ""),  # steps that make nothing
    ],
)
def test_a_hum_that_the_drives_comb_or_the_steps_of_its_converter_make_is_none(
    f_hz, height, drive, said
):
    rng = np.random.default_rng(3)
    combs = [f / 2 for f in range(85, 116) if f != 100]
    waves = [np.cos(2 * np.pi * (f * TIME + rng.uniform())) for f in combs]
    lines, teeth = (0.6 * height, 0.8 * height), 0.001 * np.sum(waves, axis=0)
    told = implausible(*stand_in(Hum(harmonics=1), {"f_hz": f_hz}, drive, teeth, lines))
    assert said in told
    assert bool(said) == bool(told)


def test_the_period_of_a_drive_is_told_from_many_of_it():
    period = Period.of(TIME, np.sin(2 * np.pi * TIME / 0.61234))
    assert period is not None
    assert period.seconds == pytest.approx(0.61234, rel=period.spread)
    assert period.spread < 6e-4
    assert period.has_multiple(200 / 0.61234, 20.0)
    assert not period.has_multiple(200.3 / 0.61234, 20.0)
    assert Period.of(TIME, CHIRP) is None
