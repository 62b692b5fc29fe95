"""The table of effects: one row each, what it makes of a course against an oracle of other make."""

from typing import Any

import numpy as np
from exported import KINDS
from scipy import signal

from preisach_jax.effects.auxiliary import Auxiliary
from preisach_jax.effects.base import InputEffect, OutputEffect
from preisach_jax.effects.cross import Cross
from preisach_jax.effects.gain import Gain

TICK = 1e-3
COUNT = 120


def course(seed, straight=4):
    """Uneven times that lie on a raster of `TICK`, and a signal straight over some intervals."""
    rng = np.random.default_rng(seed)
    ticks = np.concatenate([[0], np.cumsum(rng.integers(1, 10, COUNT - 1))])
    time, knots = ticks * TICK, 3.0 + np.cumsum(rng.normal(size=COUNT))
    return ticks, time, np.interp(time, time[::straight], knots[::straight])


def linear(ticks, values, b, a):
    """b(s)/a(s) at rest before the first value, its input straight between samples, by SciPy."""
    fine = np.interp(np.arange(ticks[-1] + 1), ticks, values)
    found: Any = signal.cont2discrete((b, a), TICK, "foh")
    moved = signal.lfilter(np.ravel(found[0]), found[1], fine - fine[0])[ticks]
    return b[-1] / a[-1] * values[0] + moved


# What effects with values p make of ticks k, time t and a course v.


def slow_lag(k, t, v, p):
    return linear(k, v, [1.0], [p["tau_s"], 1.0])


def slow_creep(k, t, v, p):
    return v + sum(c * linear(k, v, [1.0], [tau, 1.0]) for c, tau in zip(p.values(), TAU_S))  # noqa: B905


def slow_mode(k, t, v, p, end="", rate=False):
    w, zeta = 2 * np.pi * p[f"f{end}_hz"], p["zeta" + end]
    return linear(k, v, [w, 0.0] if rate else [w * w], [1.0, 2 * zeta * w, w * w])


def slow_modes(k, t, v, p):
    return slow_mode(k, t, v, p) + p["gain_2"] * slow_mode(k, t, v, p, "_2")


def slow_turned(k, t, v, p):
    return [slow_mode(k, t, v, p, end, rate) for end in ("", "_2") for rate in (False, True)]


def slow_slew_limit(k, t, v, p, fine=2000):
    """u' runs towards u at no more than the slew, in many small steps between the samples."""
    driven, limited = v[0], [v[0]]
    for n in range(1, len(v)):
        reach = p["slew"] * (t[n] - t[n - 1]) / fine
        for goal in np.linspace(v[n - 1], v[n], fine + 1)[1:].tolist():
            driven += min(max(goal - driven, -reach), reach)
        limited.append(driven)
    return np.array(limited)


def slow_settling(k, t, v, p):
    return (1 - np.exp(-t / p["tau_s"])) / (1 - np.exp(-0.6 / p["tau_s"]))


def slow_viscosity(k, t, v, p):
    w = linear(k, v, [1.0, 0.0], [p["tau_s"], 1.0])
    dry = np.tanh(w / p["speed"])
    return [w, dry, dry * np.exp(-np.abs(w) / p["stribeck_speed"])]


def slow_gain(k, t, v, p):
    x = (slow_lag(k, t, v, p) - 2.0) / 20.0
    return 1 + p["gain"] * 20.0 * (x + p["curvature"] * (x**2 - 0.25))


def slow_roots(k, t, v, p):
    slope = np.diff(v) / np.diff(t)
    rate = (np.append(slope[0], slope) + np.append(slope, slope[-1])) / 2
    return np.sign(rate) * np.sqrt(np.abs(rate))


def slow_rounding(k, t, v, p):
    lattice = p["step"] * np.arange(-200, 200)
    return lattice[np.argmin(np.abs(v[:, None] - lattice), axis=1)]


def slow_hum(k, t, v, p):
    waves = [np.exp(2j * np.pi * p["f_hz"] * n * t) for n in (1, 2, 3)]
    return [part(wave) for wave in waves for part in (np.real, np.imag)]


def slow_widening(k, t, v, p):
    """The mean speed over two intervals, raised to a power."""
    speed = np.abs(v[2:] - v[:-2]) / (t[2:] - t[:-2])
    return p["coefficient"] * (np.pad(speed, 1, "edge") / 50.0) ** p["exponent"]


def slow_log_rate(k, t, v, p):
    speed = np.abs(np.diff(v) / np.diff(t))
    return p["coefficient"] * np.log10(1 + np.append(speed[0], speed) / p["slow_speed"])


def slow_eddy(k, t, v, p):
    rate = np.diff(np.cos(v)) / np.diff(t)
    return v - p["k"] * np.append(0.0, rate)


def slow_moving(k, t, v, p):
    return 2.0 + (v - 2.0 + p["a"] * np.cos(v)) / (1 + p["a"] * 3.0 / 20.0)


def slow_ripples(k, t, v, p):
    x = (v + 20.0) / 50.0
    legendre = [np.polynomial.legendre.legval(2 * x - 1, np.eye(4)[n]) for n in (2, 3)]
    return [*legendre, *(np.cos(2 * np.pi * x * waves) for waves in (1.0, 1.5, 2.0, 2.5, 3.0))]


TAU_S = (0.004, 0.05, 0.9)
GAINS = {"c_1": 0.2, "c_2": 0.05, "c_3": 0.3}
TWO_MODES = {"f_hz": 20.0, "zeta": 0.05, "f_2_hz": 70.0, "zeta_2": 0.1}
SPEEDS = {"tau_s": 0.01, "speed": 120.0, "stribeck_speed": 300.0}
FRICTION = KINDS["viscosity"](fastest=1000.0, saturates=True, stribeck=True)
POWER = {"coefficient": 0.3, "exponent": 0.7}
LOGARITHM = {"coefficient": 0.3, "slow_speed": 2.0}
BENT = {"gain": 0.02, "curvature": 0.4, "tau_s": 0.05}

# Values from the middle of the ranges of a record of about 0.6 s.
CASES: dict[str, tuple[Any, dict[str, float], Any]] = {
    "creep": (KINDS["creep"](tau_s=TAU_S), GAINS, slow_creep),
    "input_lag": (KINDS["input_lag"](), {"tau_s": 0.011}, slow_lag),
    "quick lag": (KINDS["input_lag"](), {"tau_s": 2e-4}, slow_lag),
    "output_lag": (KINDS["output_lag"](), {"tau_s": 0.013}, slow_lag),
    "delay": (
        KINDS["delay"](),
        {"delay_s": 0.0072},
        lambda k, t, v, p: np.interp(t - 0.0072, t, v),
    ),
    "resonance": (KINDS["resonance"](), {"f_hz": 21.0, "zeta": 0.08}, slow_mode),
    "stiff resonance": (KINDS["resonance"](), {"f_hz": 210.0, "zeta": 0.001}, slow_mode),
    "two modes": (KINDS["resonance"](modes=2), TWO_MODES | {"gain_2": -0.5}, slow_modes),
    "slew_limit": (KINDS["slew_limit"](), {"slew": 170.0}, slow_slew_limit),
    "input_quantisation": (KINDS["input_quantisation"](), {"step": 0.3}, slow_rounding),
    "leakage": (KINDS["leakage"](), {"tau_s": 0.02}, lambda k, t, v, p: v - slow_lag(k, t, v, p)),
    "drift": (KINDS["drift"](horizon_s=0.6), {"tau_s": 0.2}, slow_settling),
    "hum": (KINDS["hum"](), {"f_hz": 7.3}, slow_hum),
    "ageing": (
        KINDS["ageing"](horizon_s=0.6),
        {"loss": 0.1, "tau_s": 0.4},
        lambda k, t, v, p: 1 - 0.1 * slow_settling(k, t, v, p),
    ),
    "aux:c": (Auxiliary("c", "N"), {"tau_s": 0.02}, slow_lag),
    "gain:c": (Gain("c", "A", 1e-9, 1.0, middle=2.0, span=20.0), BENT, slow_gain),
    "cross:c": (Cross("c", "V"), {"f_hz": 60.0, "zeta": 0.5}, slow_mode),
    "turned modes": (Cross("c", "V", modes=2, turned=True), TWO_MODES, slow_turned),
    "viscosity": (FRICTION, SPEEDS, slow_viscosity),
    "excess_loss": (KINDS["excess_loss"](), {}, slow_roots),
    "rate_dependence": (KINDS["rate_dependence"](reference_per_s=50.0), POWER, slow_widening),
    "log_rate": (KINDS["log_rate"](with_corners=True), LOGARITHM, slow_log_rate),
    "eddy_currents": (KINDS["eddy_currents"](), {"k": 0.01}, slow_eddy),
    "moving": (KINDS["moving"](2.0, 20.0, 3.0), {"a": 0.4}, slow_moving),
    "output_quantisation": (KINDS["output_quantisation"](), {"step": 0.3}, slow_rounding),
    "ripples": (KINDS["output_nonlinearity"](-20.0, 50.0, half_waves=6), {}, slow_ripples),
}
ROUNDED = ("creep", "quick lag", "resonance", "stiff resonance", "viscosity")
"""Effects that sum or turn over many samples: in single precision as well."""
ALIKE = ("quick lag", "output_lag", "stiff resonance", "two modes")
"""Cases of the laws of other ones."""
ELSEWHERE = [KINDS[name] for name in ("operator_creep", "reptation", "restoring_force")]
"""Effects that `test_hysteresis_effects` and `test_restoring_force` hold to loops of their own."""
SIGNALS = (InputEffect, OutputEffect)
STEPPED = [n for n, case in CASES.items() if isinstance(case[0], SIGNALS) and n not in ALIKE]
