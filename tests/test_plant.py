"""The simulated stage obeys Preisach's laws, and each effect is what its truth says."""

import json
from typing import Any

import numpy as np
import pytest
from scipy import optimize, signal

from preisach_jax.errors import InputError
from preisach_jax.plant import EFFECTS, RANGE_V, make_stage, simulate_stage
from preisach_jax.plant import stage as stage_module
from preisach_jax.signals import diagnostic_record

SHORT: dict[str, Any] = {"seconds": 6.0, "rate_hz": 1000.0}
QUIET: dict[str, Any] = {"noise_um": 0.0, "encoder_step_um": 0.0}
CLEAN = {**SHORT, **QUIET}


def system_of(b, a, x, t):
    """b(s)/a(s) at rest at x[0], of unit gain at rest or none, by SciPy."""
    return signal.lsim((b, a), x - x[0], t)[1] + b[-1] / a[-1] * x[0]


def first_order(x, tau, t):
    return system_of([1.0], [tau, 1.0], x, t)


def finely(rec, parts=10):
    """Instants, drive and a selection of the record's: straight between the samples."""
    t = np.linspace(0.0, rec.time[-1], parts * (rec.time.size - 1) + 1)
    return t, np.interp(t, rec.time, rec.input), slice(None, None, parts)


def slow_plays(stage, u, widening):
    """All plays instant by instant."""
    v = np.minimum(RANGE_V - stage.slack_up, stage.slack_down)
    outputs = [v]
    for value, wider in zip(u, widening, strict=True):
        v = np.maximum(v, value - stage.slack_up - wider)
        v = np.minimum(v, value + stage.slack_down + wider)
        outputs.append(v)
    g = stage.softness * np.log1p(np.exp((np.array(outputs) - stage.dead_zone) / stage.softness))
    h = g @ stage.weights
    return h[1:] - h[0]


# --- the hysteresis ---


def test_plays_against_a_loop_with_slacks_that_grow_and_shrink(monkeypatch):
    """At random, and while the drive rests; long ramps are cut without a trace."""
    stage = make_stage(4)
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(0.0, RANGE_V, 200), 4)
    widening = rng.uniform(0.0, 6.0, u.size) * np.repeat(rng.integers(0, 2, 400), 2)
    plain, wider = (slow_plays(stage, u, each) for each in (0 * u, widening))
    assert np.std(wider - plain) > 0.5
    for chunk in (stage_module.CHUNK, 37):
        monkeypatch.setattr(stage_module, "CHUNK", chunk)
        np.testing.assert_allclose(stage.hysteresis(u), plain, rtol=0, atol=1e-9)
        np.testing.assert_allclose(stage.hysteresis(u, widening), wider, rtol=0, atol=1e-9)


def test_moving_against_a_root_at_each_sample():
    stage = make_stage(4)
    u, a = np.random.default_rng(5).uniform(0.0, RANGE_V, 150), 0.12
    v = np.minimum(RANGE_V - stage.slack_up, stage.slack_down)
    rest = stage.weights @ stage.generate(v)

    def plays(value, h):
        return np.clip(v, value + a * h - stage.slack_up, value + a * h + stage.slack_down)

    def missing(h, value):
        return float(stage.weights @ stage.generate(plays(value, h))) - rest - h

    expected = []
    for value in u:
        h = optimize.brentq(missing, -50.0, 200.0, args=(value,), xtol=1e-12)
        v = plays(value, h)
        expected.append(h)
    np.testing.assert_allclose(stage.moving_hysteresis(u, a), expected, rtol=0, atol=1e-6)
    with pytest.raises(ValueError, match="where it is stable"):
        stage.moving_hysteresis(np.array([0.0, 1.0]), 5.0)


# --- a record ---


def test_a_seed_means_one_record_with_its_noise_and_encoder():
    first, again, other = (simulate_stage(s, effects=("creep",), **SHORT) for s in (5, 5, 6))
    np.testing.assert_array_equal(first.output, again.output)
    assert first.truth == again.truth == json.loads(json.dumps(first.truth))
    assert np.std(first.output - other.output) > 0.1
    clean, rec = simulate_stage(1, **CLEAN), simulate_stage(1, **SHORT)
    assert (rec.aux, rec.truth["effects"]) == ({}, [])
    np.testing.assert_allclose(rec.time, np.arange(6000) / 1000.0)
    np.testing.assert_allclose(clean.output, make_stage(1).hysteresis(rec.input), rtol=0, atol=1e-9)
    spread = np.std(rec.output - clean.output)
    assert spread == pytest.approx(np.hypot(0.006, 1.22e-3 / np.sqrt(12)), rel=0.05)
    np.testing.assert_allclose(rec.output / 1.22e-3, np.round(rec.output / 1.22e-3), atol=1e-6)
    assert not np.any(np.signbit(rec.output) & (rec.output == 0.0))


# --- each effect against what its truth says ---


def creeping(rec, p, h):
    pairs = zip(p["tau_s"], p["gains"], strict=True)
    return h + sum(gain * first_order(h, tau, rec.time) for tau, gain in pairs)


def settled(t, tau):
    return (1 - np.exp(-t / tau)) / (1 - np.exp(-t[-1] / tau))


def bending(rec, p, h):
    """A cubic that is right at both ends."""
    (a2, a3), x = p["coefficients_um"], 2 * h / rec.truth["stroke_um"] - 1
    return h + a2 * (1 - x**2) + a3 * 1.5 * np.sqrt(3) * (x - x**3)


def mode(p, x, t):
    w = 2 * np.pi * p["f_hz"]
    return system_of([w * w], [1.0, 2 * p["zeta"] * w, w * w], x, t)


def resisting(rec, p, h):
    t, u, rows = finely(rec)
    speed = system_of([1.0, 0.0], [p["tau_s"], 1.0], u, t)[rows]
    dry = p["saturating_um"] * np.tanh(speed / p["speed_V_per_s"])
    return h + p["viscous_um_s_per_V"] * speed + dry


def losing(rec, p, h):
    rate = np.diff(rec.input, prepend=rec.input[0]) * 1000.0  # on the way to each sample
    return h + p["coefficient"] * np.sign(rate) * np.sqrt(np.abs(rate))


def humming(rec, p):
    lines, phase = zip(p["amplitude_um"], p["phase_rad"], strict=True), 2 * np.pi * p["f_hz"]
    return sum(a * np.sin(n * phase * rec.time + own) for n, (a, own) in enumerate(lines, start=1))


# What a record, the parameters and the output without the effect make; and the tolerance in um.
ORACLES: dict[str, tuple[Any, float]] = {
    "creep": (creeping, 2e-3),
    "drift": (lambda rec, p, h: h + p["amplitude_um"] * settled(rec.time, p["tau_s"]), 1e-9),
    "ageing": (lambda rec, p, h: h * (1 - p["loss"] * settled(rec.time, p["tau_s"])), 1e-9),
    "hum": (lambda rec, p, h: h + humming(rec, p), 1e-9),
    "viscosity": (resisting, 5e-4),
    "excess_loss": (losing, 1e-5),
    "output_nonlinearity": (bending, 1e-9),
    "output_quantisation": (lambda rec, p, h: np.rint(h / p["step_um"]) * p["step_um"], 1e-9),
    "aux:load_N": (
        lambda rec, p, h: h + p["gain_um_per_N"] * (rec.aux["load_N"] - rec.aux["load_N"][0]), 1e-9
    ),
    "gain:temp_C": (
        lambda rec, p, h: h * (1 + p["gain_per_C"] * (rec.aux["temp_C"] - 20.0)), 1e-9
    ),
    "cross:y_V": (
        lambda rec, p, h: h + p["gain_um_per_V"] * mode(
            p, rec.aux["y_V"] - rec.aux["y_V"][0], rec.time
        ), 0.02
    ),
    "leakage": (
        lambda rec, p, h: system_of([p["tau_s"], 0.0], [p["tau_s"], 1.0], h, rec.time) + h[0], 0.1
    ),
    "moving": (
        lambda rec, p, h: make_stage(2).hysteresis(rec.input + p["a_V_per_um"] * rec.output), 1e-6
    ),
}  # fmt: skip


def changed(drive=lambda p, u, t: u, position=lambda p, h, t: h):
    """Laws of the drive, straight between the samples, and of what the hysteresis makes of it."""

    def oracle(rec, p, h):
        t, u, rows = finely(rec)
        return position(p, make_stage(2).hysteresis(drive(p, u, t)), t)[rows]

    return oracle


def of_speed(law):
    def oracle(rec, p, h):
        _, drive, rows = finely(rec, 10)
        rate = np.abs(np.diff(drive, prepend=drive[0])) * 10_000.0
        return slow_plays(make_stage(2), drive, law(p, rate))[rows]

    return oracle


ORACLES |= {
    "input_lag": (
        changed(drive=lambda p, u, t: np.clip(first_order(u, p["tau_s"], t), 0, RANGE_V)), 0.01
    ),
    "input_quantisation": (
        changed(drive=lambda p, u, t: np.rint(u / p["step_V"] + 1e-9) * p["step_V"]), 1e-9
    ),
    "output_lag": (changed(position=lambda p, h, t: first_order(h, p["tau_s"], t)), 5e-3),
    "delay": (changed(position=lambda p, h, t: np.interp(t - p["delay_s"], t, h)), 5e-3),
    "resonance": (changed(position=mode), 5e-3),
    "rate_dependence": (of_speed(lambda p, rate: p["coefficient"] * rate ** p["exponent"]), 1e-6),
    "log_rate": (
        of_speed(lambda p, rate: p["coefficient_V"] * np.log10(1 + rate / p["slow_V_per_s"])), 1e-6
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ORACLES)
def test_an_effect_is_what_its_truth_says(name, tmp_path):
    oracle, atol = ORACLES[name]
    settings: dict[str, Any] = CLEAN
    if name in ("rate_dependence", "log_rate"):
        settings = CLEAN | {"drive": diagnostic_record(6.0, 1000.0, 0.0, RANGE_V)[1500:3000]}
    seed = 3 if name == "viscosity" else 2  # of which the dry part is not nothing
    rec, bare = (simulate_stage(seed, effects=each, **settings) for each in ((name,), ()))
    assert list(rec.truth["parameters"]) == rec.truth["effects"] == [name]
    if name == "aux:load_N":  # it is saved as it is
        rec.save(tmp_path / "stage.csv")
        read = np.genfromtxt(tmp_path / "stage.csv", delimiter=",", names=True)
        assert read.dtype.names == ("t_s", "u_V", "z_um", "load_N")
        np.testing.assert_allclose(read["load_N"], rec.aux["load_N"], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(read["z_um"], rec.output, rtol=1e-9, atol=1e-12)
    expected = oracle(rec, rec.truth["parameters"][name], bare.output)
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=atol)
    assert np.std(rec.output - bare.output) > max(2 * atol, 1e-3)
    np.testing.assert_array_equal(rec.input, bare.input)


def test_slew_limit_on_ramps():
    """Closed form: two ramps that are too fast, with time to arrive, and one that is not."""
    t = np.arange(1200) / 1000.0
    drive = np.interp(t, [0.1, 0.2, 0.6, 0.7, 1.0, 1.2], [5.0, 65.0, 65.0, 15.0, 15.0, 30.0])
    rec = simulate_stage(2, effects=("slew_limit",), drive=drive, **CLEAN)
    slew = rec.truth["parameters"]["slew_limit"]["slew_V_per_s"]
    assert 0.3 * 600.0 <= slew <= 0.8 * 600.0
    late = np.interp(t, [0.1, 0.1 + 60 / slew, 0.6, 0.6 + 50 / slew], [5.0, 65.0, 65.0, 15.0])
    expected = make_stage(2).hysteresis(np.where(t < 1.0, late, drive))
    np.testing.assert_allclose(rec.output, expected, rtol=0, atol=1e-6)


# --- several together ---


WITHOUT_PLAYS = ("rate_dependence", "log_rate", "moving")
TOGETHER = [name for name in EFFECTS if name not in (*WITHOUT_PLAYS, "restoring_force")]


def test_springs_hold_the_stage():
    made = simulate_stage(1, effects=("restoring_force",), **SHORT)
    law = made.truth["parameters"]["restoring_force"]
    assert made.output[0] == pytest.approx(0, abs=0.05)
    # Where the drive rests at its top, springs of this stiffness hold it, the yielded one less.
    assert np.ptp(made.output) > 75.0 / law["stiffness_V_per_um"]


def test_effects_are_simulated_together_with_their_own_truths():
    drive = np.interp(np.arange(301) / 60, np.arange(6), [0.0, 70.0, 20.0, 55.0, 55.0, 5.0])
    for effects in ([*TOGETHER, "restoring_force"], [*TOGETHER, *WITHOUT_PLAYS]):
        rec = simulate_stage(2, effects=effects, drive=drive, rate_hz=500.0)
        for name in effects[::5]:
            alone = simulate_stage(2, effects=(name,), drive=drive, rate_hz=500.0)
            assert rec.truth["parameters"][name] == alone.truth["parameters"][name]
        still = simulate_stage(2, effects=effects, drive=np.full(500, 30.0), rate_hz=500.0)
        for each in (rec, still):
            assert np.all(np.isfinite(each.output))
            assert json.loads(json.dumps(each.truth, allow_nan=False)) == each.truth


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"effects": ("wear",)}, "no effect 'wear': choose from creep, input_lag"),
        ({"effects": "creep"}, "give a list"),
        ({"effects": ("aux", "aux:load_N")}, "only once"),
        ({"effects": ("restoring_force", "moving")}, "on which moving acts; leave one"),
        ({"seed": -1}, "seed is -1"),
        ({"seconds": 1.0}, "too few"),
        ({"rate_hz": float("nan")}, "rate_hz is nan"),
        ({"noise_um": -1.0}, "noise_um is -1.0"),
        ({"drive": np.array([0.0, 80.0])}, "from 0.0 to 80.0"),
        ({"drive": np.zeros((2, 2))}, r"shape \(2, 2\)"),
    ],
)
def test_what_cannot_be_simulated_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        simulate_stage(**{"seed": 0, **changes})
