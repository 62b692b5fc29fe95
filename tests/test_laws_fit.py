"""Laws of the fit: units, clocks and the order of effects do not matter, errors are as stated."""

import numpy as np
import pytest
import world

import preisach_jax as pj

RATE, SAMPLES, LEVELS = 100.0, 1000, 9
EFFECTS = ("output_lag", "drift")


def measured(input_scale=1.0, output_scale=1.0, begin=0.0, units=("V", "um"), seed=5):
    """A lagged and drifting stage, whose values are told in any units and by any clock."""
    drive = world.excitation("rich", SAMPLES / RATE, RATE, seed)
    time = np.arange(len(drive)) / RATE
    still = world.make_world(seed).hysteresis(drive)
    lagged = np.copy(still)
    for k in range(1, len(still)):
        lagged[k] += (lagged[k - 1] - still[k]) * np.exp(-1 / RATE / 0.03)
    output = lagged + 0.5 * time / time[-1]
    output += 0.01 * np.random.default_rng(seed).normal(size=len(time))
    names = {"input": units[0], "output": units[1]}
    return pj.Record.from_arrays(
        begin + time, input_scale * drive, output_scale * output, units=names
    )


@pytest.fixture(scope="module")
def record():
    return measured()


@pytest.fixture(scope="module")
def fitted(record):
    return pj.fit(record, EFFECTS, levels=LEVELS)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_stated_errors_are_those_of_the_prediction(fitted, record):
    error = record.output - fitted.prediction
    held_out, used = fitted.validation, fitted.identification
    assert not np.any(held_out & used)
    assert np.all(held_out | used)
    assert fitted.rms_validation == pytest.approx(rms(error[held_out]), rel=1e-12)
    assert fitted.rms_identification == pytest.approx(rms(error[used]), rel=1e-12)
    assert fitted.max_abs_validation == np.abs(error[held_out]).max()
    spread = record.output[held_out] - record.output[held_out].mean()
    percent = 100 * (1 - rms(error[held_out]) / rms(spread))
    assert fitted.fit_percent == pytest.approx(percent, rel=1e-12)
    assert fitted.model.rms_validation == fitted.rms_validation


def test_the_model_predicts_its_own_record_as_well_as_is_stated(fitted, record):
    own = fitted.model.predict(record)
    error = record.output - own.output
    # It has learnt the held-out rows too.
    assert rms(error[fitted.validation]) < 1.02 * fitted.rms_validation
    assert rms(error[fitted.identification]) < 1.2 * fitted.rms_identification
    assert np.abs(own.output - fitted.prediction).max() < 10 * fitted.rms_validation
    # Else these would be the laws of a fit that has found nothing.
    assert fitted.model.parameters["output_lag"]["tau_s"].value == pytest.approx(0.03, rel=0.2)
    assert fitted.rms_validation < 0.01 * np.ptp(fitted.prediction)


def test_units_and_the_begin_of_the_clock_change_numbers_and_nothing_else(fitted):
    later = measured(1e3, 1e-3, begin=1000.0, units=("mV", "mm"))
    other = pj.fit(later, EFFECTS, levels=LEVELS)
    stroke = np.ptp(fitted.prediction)
    np.testing.assert_allclose(1e3 * other.prediction, fitted.prediction, atol=1e-6 * stroke)
    np.testing.assert_array_equal(other.validation, fitted.validation)
    for effect, parameters in fitted.model.parameters.items():
        for name, found in parameters.items():
            scale = 1e3 if found.unit == "um" else 1.0
            value = scale * other.model.parameters[effect][name].value
            assert value == pytest.approx(found.value, rel=1e-4, abs=1e-9)


def test_the_order_in_which_effects_of_different_places_are_named_does_not_matter(fitted, record):
    """Up to where the search ends, a small part of what the model leaves."""
    other = pj.fit(record, EFFECTS[::-1], levels=LEVELS)
    near = 0.05 * fitted.rms_validation
    np.testing.assert_allclose(other.prediction, fitted.prediction, rtol=0, atol=near)
    assert other.rms_validation == pytest.approx(fitted.rms_validation, rel=1e-3)
