"""An output that falls as the input rises: a shape-memory wire, a sensor wired the other way."""

import numpy as np
import pytest
import world

import preisach_jax as pj
from preisach_jax.plot import density


def record_of(made, output, **options):
    units = {"input": "V", "output": "um"}
    return pj.Record.from_arrays(
        made["t"], made["x"], output, units=units, name="hidden", **options
    )


@pytest.mark.parametrize("effect", ["drift", "moving"])
def test_the_fit_of_the_negative_output_is_the_negative_of_the_fit(effect, tmp_path):
    made = world.hidden_record(effect if effect != "moving" else None, 11, 6.0, 500.0)
    rising, falling = (
        pj.fit(record_of(made, sign * made["z"], initial_memory="low"), [effect], levels=5)
        for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(falling.prediction, -rising.prediction, rtol=1e-9)
    np.testing.assert_allclose(falling.model.weights, -rising.model.weights, rtol=0, atol=1e-9)
    assert falling.fit_percent > 90
    for name, estimate in rising.model.parameters[effect].items():
        other = falling.model.parameters[effect][name]
        expected = np.array([estimate.value, estimate.low, estimate.high])
        if estimate.unit == "um":  # an amount of output
            expected = -expected[[0, 2, 1]]
        np.testing.assert_allclose((other.value, other.low, other.high), expected, rtol=1e-6)
    # The file keeps it, and another record is predicted from it.
    falling.save(tmp_path / "model.json")
    loaded = pj.Model.load(tmp_path / "model.json")
    other = world.hidden_record(None, 12, 3.0, 400.0)
    inside = np.clip(other["x"], made["x"].min(), made["x"].max())
    asked = record_of({**other, "x": inside}, other["z"], initial_memory="low")
    predicted = loaded.predict(asked)
    np.testing.assert_allclose(predicted.output, -rising.predict(asked).output, rtol=1e-9)
    assert np.all(predicted.low <= predicted.high)


def test_a_drift_greater_than_the_stroke_does_not_hide_the_polarity():
    sign = -1.0
    made = world.hidden_record(None, 13, 6.0, 500.0)
    rest = sign * made["z"] - sign * 8 * np.ptp(made["z"]) * made["t"] / made["t"][-1]
    assert abs(np.corrcoef(made["x"], rest)[0, 1]) < 0.5
    found = pj.fit(record_of(made, rest), ["drift"], levels=9)
    assert np.sign(found.model.weights.sum()) == sign
    assert found.rms_validation < 0.02 * np.ptp(made["z"])


def test_a_hidden_effect_is_named_and_told_alike():
    made = world.hidden_record("input_lag", 201, 6.0, 500.0)
    found = pj.diagnose(record_of(made, 100 - made["z"]), ["input_lag", "drift"], levels=9)
    assert found.effects == ("input_lag",)
    assert found.verdict == "explained"
    assert "output falls as the input rises" in found.model._repr_html_()
    bar = density(found.model).axes[1]
    assert bar.get_ylim()[1] > 0  # the density that is drawn is that of the falling hysterons
