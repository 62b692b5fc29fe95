"""Effects that promise nothing to first order are fitted all the same, before none is named."""

import numpy as np
import pytest
from found import LEVELS, ROWS, UNITS
from test_modes import plays, through

import preisach_jax as pj

RATE, SLEW, FINER = 1000, 480.0, 20


@pytest.mark.slow
def test_a_slew_limit_and_a_mode_of_which_one_promises_nothing_are_named():
    """Nine plays and a mode of 80 Hz, whose drive is limited in steps finer than the record's."""
    rng, u = np.random.default_rng(3), [40.0]
    while len(u) < ROWS:
        rate, to = rng.choice([30, 66, 66, 130, 240, 360, 640, 719]) / RATE, rng.uniform(20, 60)
        u += list(np.linspace(u[-1], to, max(int(abs(to - u[-1]) / rate), 1) + 1)[1:])
    u = np.array(u[:ROWS])
    fine, most = np.interp(np.arange(ROWS * FINER) / FINER, np.arange(ROWS), u), SLEW / RATE / FINER
    drive = fine.copy()
    for k in range(1, len(fine)):
        drive[k] = drive[k - 1] + np.clip(fine[k] - drive[k - 1], -most, most)
    h = 0.02 * sum(plays(drive[::FINER], (r,)) for r in (1, 2, 3, 4.5, 6, 8, 10, 13, 16))
    z = through(h + 0.3 * drive[::FINER], [(80.0, 0.02, 1.0)], rate_hz=RATE)
    z = z + rng.normal(0, 0.005, ROWS)
    record = pj.Record.from_arrays(np.arange(ROWS) / RATE, u, z, units=UNITS)
    found = pj.diagnose(record, ["slew_limit", "resonance"], levels=LEVELS)
    assert set(found.effects) == {"slew_limit", "resonance"}
    values = {name: each for finding in found.findings for name, each in finding.parameters.items()}
    assert values["slew"].value == pytest.approx(SLEW, rel=0.01)
    assert values["f_hz"].value == pytest.approx(80.0, rel=0.01)
    # What look calls not shown has no limit, and none is larger than the error without a word.
    cannot_tell = pj.look(found.steps[0].record).cannot_tell
    assert all(limit.effect not in cannot_tell for limit in found.limits)
    assert all(
        limit.poorly_bounded == (limit.rms > found.final.rms_validation)
        for limit in found.limits
        if limit.rms is not None
    )
