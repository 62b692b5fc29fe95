"""Effects of machines hidden in the tests' world: velocity, scaled loops, leakage, other axes.

As in `world`, nothing is shared with the package: every lag and mode is integrated here, by small
steps or by SciPy, on a raster finer than that of the record.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import world
from scipy import signal

EFFECTS = ("viscosity", "gain:temp_C", "cross:y_V", "leakage", "log_rate")
FINE_HZ = 5000.0


def euler_lag(x, tau, step):
    """tau y' = x - y by the implicit Euler rule, at rest at the first value."""
    share = step / (tau + step)
    y, _ = signal.lfilter([share], [1.0, share - 1.0], x, zi=np.array([(1.0 - share) * x[0]]))
    return y


def wandering(rng, t, slow_hz, fast_hz, count=12):
    """A sum of sines of random frequencies and phases, about 1 in amplitude."""
    f = slow_hz * (fast_hz / slow_hz) ** rng.uniform(size=count)
    phase = rng.uniform(0.0, 2 * np.pi, count)
    y = np.sin(2 * np.pi * np.outer(t, f) + phase).sum(axis=1)
    return y / np.max(np.abs(y))


def machine_record(
    effect: str | None, seed: int, seconds: float = 12.0, rate_hz: float = 500.0, size: float = 1.0,
    columns: bool = True, noise_um: float = 0.006,
) -> dict:  # fmt: skip
    """One record with at most one hidden effect, and with a temperature and another axis beside it.

    `size` scales the effect, `columns` says whether the auxiliary columns are there. Returns t, x,
    z (K,), aux {name: (K,)} and truth, units s, V, um, °C.
    """
    place, rng = world.make_world(seed), np.random.default_rng([seed, 77])
    fine = round(FINE_HZ / rate_hz)
    step, count = 1.0 / (rate_hz * fine), round(seconds * rate_hz)
    t = np.arange((count - 1) * fine + 1) * step
    u = world.waveform("rich", seconds, seed)(t)
    swing = float(rng.uniform(0.010, 0.020)) * place.stroke * size
    warm, axis = wandering(rng, t, 0.08, 0.5, 5), wandering(rng, t, 0.5, 60.0)
    rate = np.diff(u, prepend=u[0]) / step
    truth: dict = {"effect": effect, "stroke_um": place.stroke, "seed": seed}
    if effect == "log_rate":
        truth["coefficient_V"] = c = float(rng.uniform(0.004, 0.010)) * world.TOP * size
        slack = c * np.log10(1.0 + np.abs(rate) / 2.0)
        low, high = (u - slack).tolist(), (u + slack).tolist()
        held, course = u[0], []
        for below, above in zip(low, high, strict=True):
            held = min(max(held, below), above)
            course.append(held)
        h = place.hysteresis(np.array(course))
    else:
        h = place.hysteresis(u)
    if effect == "viscosity":
        truth["tau_s"] = tau = float(rng.uniform(0.5e-3, 4e-3))
        truth["saturating"] = bool(rng.uniform() < 0.5)
        speed = euler_lag(rate, tau, step)
        scale = float(rng.uniform(30.0, 200.0)) if truth["saturating"] else 500.0
        h = h + 1.5 * swing * (np.tanh(speed / scale) if truth["saturating"] else speed / scale)
    if effect == "gain:temp_C":
        truth["gain"] = g = float(rng.uniform(0.003, 0.008)) * size  # per °C
        h = h * (1.0 + g * 5.0 * warm)
    if effect == "leakage":
        truth["tau_s"] = tau = float(rng.uniform(5.0, 40.0)) / size
        h = h - euler_lag(h, tau, step)
    if effect == "cross:y_V":
        truth["f_hz"], truth["zeta"] = f, z = rng.uniform(30.0, 90.0), rng.uniform(0.02, 0.1)
        w = 2 * np.pi * f
        mode: Any = signal.cont2discrete(([w * w], [1.0, 2 * z * w, w * w]), step, "foh")
        h = h + 0.5 * swing * np.asarray(signal.lfilter(mode[0].ravel(), mode[1], axis))
    rows = slice(None, None, fine)
    out = h[rows] + np.random.default_rng([seed, 78]).normal(0.0, noise_um, count)
    aux = {"temp_C": 20.0 + 5.0 * warm[rows], "y_V": 10.0 * axis[rows]} if columns else {}
    return {"t": t[rows], "x": u[rows], "z": out, "aux": aux, "truth": truth}
