"""The inverse of a running machine, and the loop around it."""

import math
from copy import copy
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drivable import (
    EFFECTS,
    GOOD,
    PLANE,
    RATE,
    course,
    model_of,
    played,
    reading_of,
    resting_output,
)

import preisach_jax as pj
from preisach_jax.compensation.causal import Causal, check_causal
from preisach_jax.compensation.loop import ProportionalIntegral, of_control, simulated_stage
from preisach_jax.compensation.search import Limits
from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.resonance import Resonance


def driven(inverse, wanted):
    return np.array([inverse(z) for z in wanted.output.tolist()])


@cache
def _compiled_for_hysteresis():
    return pj.OnlineInverse(model_of(), RATE)


def of_hysteresis():
    """An inverse of the operator alone, at its start."""
    return copy(_compiled_for_hysteresis())


LED = {
    "creep moving eddy_currents ageing output_nonlinearity": 0.0,
    "ageing_by_path drift_by_path": 0.0,
    "input_lag rate_dependence": 25.0,
}
"""Errors in held-out ones that a causal lead may leave on this course; elsewhere it is exact."""


@pytest.mark.parametrize("names", LED)
def test_the_drive_of_one_sample_after_the_other_gives_the_course(names):
    model = model_of(*(EFFECTS[name] for name in names.split()))
    wanted = course(model)
    drive = driven(pj.OnlineInverse(model, RATE), wanted)
    error = np.abs(reading_of(model, drive) - wanted.output)[50:]
    assert error.max() < max(1e-9, LED[names] * GOOD)


def test_for_hysteresis_alone_it_is_the_drive_of_the_whole_course():
    model = model_of()
    wanted = course(model)
    whole = pj.compensate(model, wanted).drive
    np.testing.assert_allclose(driven(of_hysteresis(), wanted), whole, atol=1e-9)


def test_limits_are_kept_and_what_they_cost_is_told():
    model = model_of()
    inverse = pj.OnlineInverse(model, RATE, (4.0, 6.0), slew=50.0)
    drive, told = [], []
    for z in course(model).output.tolist():
        drive.append(inverse(z))
        told.append(abs(inverse.expected - z) <= 1.96 * GOOD)
        assert inverse.reached == told[-1]
    steps = np.abs(np.diff([model.origin.history[1, -1], *drive]))
    assert min(drive) >= 4.0
    assert max(drive) <= 6.0
    assert steps.max() <= 50.0 / RATE * (1 + 1e-9)
    assert 0 < np.mean(told) < 1


def test_a_saved_inverse_goes_on_as_it_would_have(tmp_path):
    model = model_of(EFFECTS["creep"])
    z = course(model).output.tolist()
    inverse = pj.OnlineInverse(model, RATE, (0.0, 9.0), step_size=0.2)
    for k in range(200):
        inverse(z[k], z[k - 1] + 0.01 if k else math.nan)
    inverse.save(tmp_path / "state.npz")
    other = pj.OnlineInverse.load(tmp_path / "state.npz")
    for k in range(200, 260):
        assert other(z[k], z[k - 1]) == inverse(z[k], z[k - 1])
    np.testing.assert_array_equal(other.weights, inverse.weights)
    (tmp_path / "half.npz").write_bytes((tmp_path / "state.npz").read_bytes()[:500])
    with pytest.raises(pj.InputError, match="cannot be read as a saved inverse"):
        pj.OnlineInverse.load(tmp_path / "half.npz")


def mode(f_hz, zeta):
    return (Resonance(), {"f_hz": f_hz, "zeta": zeta}, ())


LEARNT = {
    "delay resonance": (EFFECTS["delay"], mode(430.0, 0.02)),
    "": (mode(60.0, 0.05), EFFECTS["output_lag"], EFFECTS["output_nonlinearity"]),
}
"""By the effects that are left out, the effects of a stage whose weights are learnt."""


@pytest.mark.parametrize("name", LEARNT)
def test_with_readings_the_error_falls_and_the_weights_stay_bounded(name):
    model, rng = model_of(*LEARNT[name]), np.random.default_rng(4)
    fresh = pj.OnlineInverse(model, RATE, step_size=0.5, follow_s=0.1)
    assert sorted(fresh.left_out) == name.split()
    weights = model.weights * np.exp(0.15 * rng.normal(size=PLANE.cells))
    own = replace(model, coefficients=replace(model.coefficients, weights=weights))
    at_rest = simulated_stage(own, RATE)
    late = model.values.get("delay", {"delay_s": 0.0})["delay_s"] * RATE
    t = np.arange(round(RATE)) / RATE
    blend = np.clip(t / 0.25, 0, 1)
    blend = blend**2 * (3 - 2 * blend)
    begin = resting_output(model)[-1]
    z = begin + (11 + 6 * np.sin(2 * np.pi * 4 * t) - begin) * blend

    def run(learns):
        inverse, stage, outputs, drives = copy(fresh), copy(at_rest), [], []
        reading = math.nan
        for k, wanted in enumerate(z.tolist()):
            drives.append(inverse(wanted, reading if learns else math.nan))
            outputs.append(stage(drives[-1], {}))
            reading = float(np.interp(k - late, np.arange(k + 1), outputs))
        assert np.ptp(drives) < 10.0
        periods = np.split(np.array(outputs) - z, 4)
        return inverse.weights, [np.sqrt(np.mean(period**2)) for period in periods]

    (learnt, errors), (_, blind) = run(True), run(False)
    assert 0 <= learnt.min() <= learnt.max() < 3 * weights.max()
    assert errors[3] < 0.6 * blind[3]
    assert errors[3] < errors[1] < blind[1]


def test_what_is_not_led_is_named():
    model = model_of(EFFECTS["operator_creep"], EFFECTS["reptation"])
    causal = Causal.of(model, RATE, Limits(0.0, 10.0, math.inf), None)
    assert sorted(causal.left_out) == ["operator_creep", "reptation"]


def test_readings_of_another_stage_leave_the_weights_in_bounds():
    """Readings that have nothing to do with the model, without end."""
    model, rng = model_of(mode(90.0, 0.02)), np.random.default_rng(2)
    inverse = pj.OnlineInverse(model, RATE, step_size=1.0, follow_s=0.01)
    for wanted, reading in rng.uniform([2.0, -1e3], [20.0, 1e3], (600, 2)).tolist():
        assert 0.0 <= inverse(wanted, reading) <= 10.0
    assert inverse.weights.min() >= 0
    assert inverse.weights.max() <= model.weights.sum()


def test_bad_samples_and_options_are_refused_and_the_state_is_as_before():
    inverse, other = of_hysteresis(), of_hysteresis()
    with pytest.raises(pj.InputError, match="wanted output is nan"):
        inverse(math.nan)
    with pytest.raises(pj.InputError, match="measured output is inf"):
        inverse(5.0, math.inf)
    assert inverse(5.0) == other(5.0)
    options: Any
    for options, message in (
        ({"rate_hz": 0.0}, "rate_hz is 0"),
        ({"rate_hz": RATE, "step_size": 2.0}, "step_size is 2"),
        ({"rate_hz": RATE, "limits": (2.0, 1.0)}, "lower one first"),
    ):
        with pytest.raises(pj.InputError, match=message):
            pj.OnlineInverse(model_of(), **options)


def test_an_auxiliary_column_is_asked_for_by_name():
    load = (Auxiliary(column="load_N", unit="N"), {"tau_s": 0.01}, (0.2,))
    model = model_of(load, record=played(load_N=2.0))
    inverse = pj.OnlineInverse(model, RATE)
    with pytest.raises(pj.InputError, match="auxiliary column 'load_N'"):
        inverse(5.0)
    assert math.isfinite(inverse(5.0, aux={"load_N": 2.0}))
    with pytest.raises(pj.InputError, match="needs the auxiliary column 'load_N'"):
        pj.compensate(model, course(model_of()))


def test_the_error_falls_with_each_part_of_the_inverse_with_and_without_control():
    model = model_of(EFFECTS["creep"], EFFECTS["drift"])
    wanted = course(model, seconds=0.3)
    alone = pj.simulate_loop(model, wanted)
    for name, drive in alone.drives.items():  # the stage is the model
        expected = reading_of(model, np.pad(drive, (0, 700), "edge"))[: len(drive)]
        np.testing.assert_allclose(alone.readings[name], expected, atol=1e-6)
    errors = list(alone.errors(0.1).values())
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-9
    # A controller of the package, and the same one as a transfer function of python-control.
    control = pytest.importorskip("control")
    system = control.tf([0.2 + 0.04, -0.2], [1.0, -1.0], 1 / RATE)
    at_rest = simulated_stage(model, RATE)
    controlled = pj.simulate_loop(
        model, wanted, stage=lambda: copy(at_rest), controller=lambda: system
    ).errors(0.1)
    assert controlled["no compensation"] < errors[0] / 2
    assert controlled["hysteresis only"] < errors[2] / 2
    own, theirs = ProportionalIntegral(0.2, 40.0, RATE), of_control(system)
    for error in np.random.default_rng(0).normal(size=50):
        assert theirs(error) == pytest.approx(own(error), abs=1e-9)


def test_what_scales_by_the_input_is_not_followed_from_sample_to_sample():
    class SelfHeating(pj.WeightEffect):
        name = "self_heating"

    model: Any = SimpleNamespace(effects=(SelfHeating(),))
    with pytest.raises(pj.InputError, match="'self_heating' cannot be followed"):
        check_causal(model)
    check_causal(model_of(EFFECTS["ageing"]))
