"""Slow answers, written out word for word from the text, and paths and runs to compare."""

from itertools import pairwise

import numpy as np

from preisach_jax.operator.plane import Plane

PLANE = Plane(levels=5, low=-2.0, high=8.0)  # thresholds, and positions of ramps, are exact
SAMPLES = 400
"""Of most records of the filters, so that what is compiled for one serves all."""


def slow_relays(plane, x):
    """(time, cells) relays from saturated low, by the text around eq. (1)-(4)."""
    on = (x[0] > plane.alpha).astype(int)
    rows = [on]
    for before, now in pairwise(x):
        if now > before:
            on = np.where(now >= plane.alpha, 1, on)
        elif now < before:
            on = np.where(now <= plane.beta, 0, on)
        rows.append(on)
    return np.array(rows)


def slow_ramps(plane, x):
    """(time, cells) ramps from saturated low: each goes up the line at α and down that at β."""
    state, rows = np.zeros(plane.cells), []
    for value in x:
        place = (value - plane.low) / plane.delta_x
        up, down = (np.clip(place - cell, 0, 1) for cell in (plane.alpha_index, plane.beta_index))
        state = np.minimum(down, np.maximum(state, up))
        rows.append(state)
    return np.array(rows)


def slow_states(plane, x, hysteron):
    return slow_relays(plane, x).astype(float) if hysteron == "relay" else slow_ramps(plane, x)


def play(x, width, start=None):
    """The play operator of half a width, sample by sample, at rest unless it starts elsewhere."""
    place, course = x[0] if start is None else start, []
    for value in np.asarray(x).tolist():
        place = min(max(place, value - width), value + width)
        course.append(place)
    return np.array(course)


def wandering(plane=PLANE, samples=SAMPLES, seed=1, speed=0.37, high=None):
    """Ramps between random turning points: several samples to a level, so that many switch none."""
    rng, high = np.random.default_rng(seed), plane.high if high is None else high
    path, goal = [plane.low], high
    while len(path) < samples:
        step = speed * plane.delta_x
        path.append(path[-1] + np.clip(goal - path[-1], -step, step))
        if path[-1] == goal:
            goal = rng.uniform(plane.low, high)
    return np.array(path)


def one_by_one(online, x, z, **keywords):
    """Outputs, errors and what switched, of single samples."""
    rows = []
    for sample in zip(x.tolist(), z.tolist(), strict=True):
        online(*sample, **keywords)
        rows.append(online.info)
    return [np.array(column) for column in zip(*rows, strict=True)]


def by_blocks(online, x, z, size=100, **keywords):
    rows = []
    for begin in range(0, len(x), size):
        online.block(x[begin : begin + size], z[begin : begin + size], **keywords)
        rows.append(online.info)
    return [np.concatenate(column) for column in zip(*rows, strict=True)]
