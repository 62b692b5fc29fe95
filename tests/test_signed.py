"""Outputs that fall as the input rises, and butterfly loops, whose densities have both signs.

The oracle is a function of a play operator, g(P_r[u]): a Preisach operator whose density lies
on the line α - β = 2 r and is g' there (M. Brokate, J. Sprekels, Hysteresis and Phase Transitions,
Springer 1996, ch. 2), so for g that falls and rises the density has both signs.
"""

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import world
from oracles import play

import preisach_jax as pj
from preisach_jax.plot import density

WIDTH, NOISE = 0.15, 0.002


def drive(seed, count=3000):
    """Lines between random turning points from -1 to 1, of different rates."""
    rng = np.random.default_rng(seed)
    turns = np.concatenate([[0.0, 1.0, -1.0], rng.uniform(-1, 1, 40)])
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)) * rng.uniform(0.5, 2.0, 42))])
    time = np.arange(count) / 100
    return time, np.interp(time, travel * time[-1] / travel[-1], turns)


def recorded(seed, of_play):
    time, u = drive(seed)
    noise = np.random.default_rng([seed, 1]).normal(0.0, NOISE, len(u))
    z = of_play(play(u, WIDTH)) + noise
    return pj.Record.from_arrays(time, u, z, units={"input": "kV", "output": "um"})


def butterfly(seed):
    return recorded(seed, np.square)


@pytest.fixture(scope="module")
def fitted():
    return pj.fit(butterfly(1), levels=9)


def test_a_butterfly_is_fitted_to_its_noise_and_the_grid(fitted):
    assert fitted.model.chain.signed
    assert fitted.model.weights.min() < -0.1 * fitted.model.weights.max()
    assert fitted.rms_validation < 5 * NOISE


def test_neither_a_bend_nor_a_lag_nor_much_noise_asks_for_both_signs():
    plain = recorded(3, lambda p: p + 0.3 * p**3)
    late = np.interp(plain.time - 0.2, plain.time, plain.output)
    noisy = plain.output + np.random.default_rng(0).normal(0.0, 0.2, len(late))
    for output in (plain.output, late, noisy):
        fit = pj.fit(pj.Record.from_arrays(plain.time, plain.input, output), levels=9)
        assert not fit.model.chain.signed
        assert fit.model.weights.min() >= 0


def test_a_model_of_both_signs_is_saved_and_loaded(fitted, tmp_path):
    fitted.save(tmp_path / "model.json")
    loaded = pj.Model.load(tmp_path / "model.json")
    assert loaded.chain.signed
    other = butterfly(2)
    predicted = loaded.predict(other).output
    assert np.array_equal(predicted, fitted.predict(other).output)
    assert np.sqrt(np.mean((other.output - predicted) ** 2)) < 0.04


def test_its_density_is_drawn_with_its_signs(fitted):
    mesh: Any = density(fitted.model).axes[0].collections[0]
    assert mesh.norm.vmin == -mesh.norm.vmax < 0
    assert mesh.get_cmap() == mpl.colormaps["PuOr"]
    drawn = np.ma.compressed(mesh.get_array())
    assert drawn.min() < 0 < drawn.max()


def test_a_diagnosis_says_so_and_does_not_try_what_feeds_back():
    found = pj.diagnose(butterfly(1), ["moving"], levels=5)
    assert found.effects == ()
    assert any("weights of both signs" in note for note in found.notes)
    (moving,) = [each for each in found.candidates if each.effect == "moving"]
    assert "both signs" in moving.why_not
    with pytest.raises(pj.InputError, match="both signs, beside which moving has no unique output"):
        pj.fit(butterfly(1), ("moving",), levels=5)


def test_what_needs_an_inverse_refuses_a_model_of_both_signs(fitted):
    for use in (
        lambda: pj.compensate(fitted.model, butterfly(2)),
        lambda: pj.OnlineInverse(fitted.model, 100.0),
    ):
        with pytest.raises(pj.InputError, match="weights of both signs: along a branch"):
            use()


# --- an output that falls as the input rises: a sensor wired the other way ---


def record_of(made, output, **options):
    units = {"input": "V", "output": "um"}
    return pj.Record.from_arrays(
        made["t"], made["x"], output, units=units, name="hidden", **options
    )


def test_the_fit_of_the_negative_output_is_the_negative_of_the_fit():
    made, effects = world.hidden_record("drift", 11, 6.0, 500.0), ("drift", "moving")
    rising, falling = (
        pj.fit(record_of(made, sign * made["z"], initial_memory="low"), effects, levels=5)
        for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(falling.prediction, -rising.prediction, rtol=1e-9)
    np.testing.assert_allclose(falling.model.weights, -rising.model.weights, rtol=0, atol=1e-9)
    assert falling.fit_percent > 90
    assert "output falls as the input rises" in falling.model._repr_html_()
    bar = density(falling.model).axes[1]
    assert bar.get_ylim()[1] > 0  # the density that is drawn is that of the falling hysterons
    for effect in effects:
        for name, estimate in rising.model.parameters[effect].items():
            other = falling.model.parameters[effect][name]
            expected = np.array([estimate.value, estimate.low, estimate.high])
            if estimate.unit == "um":  # an amount of output
                expected = -expected[[0, 2, 1]]
            np.testing.assert_allclose((other.value, other.low, other.high), expected, rtol=1e-6)
    # Another record is predicted from it.
    other = record_of(made | {"x": made["x"][::-1]}, made["z"], initial_memory="low")
    predicted = falling.model.predict(other)
    np.testing.assert_allclose(predicted.output, -rising.predict(other).output, rtol=1e-9)
    assert np.all(predicted.low <= predicted.high)


def test_a_drift_greater_than_the_stroke_does_not_hide_the_polarity():
    made = world.hidden_record(None, 13, 6.0, 500.0)
    rest = 8 * np.ptp(made["z"]) * made["t"] / made["t"][-1] - made["z"]
    assert abs(np.corrcoef(made["x"], rest)[0, 1]) < 0.5
    found = pj.fit(record_of(made, rest), ["drift"], levels=9)
    assert found.model.weights.sum() < 0
    assert found.rms_validation < 0.02 * np.ptp(made["z"])
