"""Effects that promise nothing to first order are fitted all the same, before none is named."""

import numpy as np
import pytest
from test_modes import plays, through

import preisach_jax as pj

RATE = 1000


def behind_a_slew_limit(seed, count=4000, slew=480.0, finer=20):
    """Nine plays, a mild bend and a mode of 80 Hz, whose drive is limited in steps of its own."""
    rng, u = np.random.default_rng(seed), [40.0]
    while len(u) < count:
        rate, to = rng.choice([30, 66, 66, 130, 240, 360, 640, 719]) / RATE, rng.uniform(20, 60)
        u += list(np.linspace(u[-1], to, max(int(abs(to - u[-1]) / rate), 1) + 1)[1:])
    u = np.array(u[:count])
    fine, most = np.interp(np.arange(count * finer) / finer, np.arange(count), u), slew / RATE
    drive = fine.copy()
    for k in range(1, len(fine)):
        change = fine[k] - drive[k - 1]
        drive[k] = drive[k - 1] + np.clip(change, -most / finer, most / finer)
    drive = drive[::finer]
    h = 0.3 * drive + 0.02 * sum(plays(drive, (r,)) for r in (1, 2, 3, 4.5, 6, 8, 10, 13, 16))
    z = through(h + 0.0006 * (drive - 40) ** 2, [(80.0, 0.02, 1.0)], rate_hz=RATE)
    z = z + rng.normal(0, 0.005, count)
    units = {"input": "V", "output": "um"}
    return pj.Record.from_arrays(np.arange(count) / RATE, u, z, units=units)


@pytest.mark.slow
def test_a_slew_limit_and_a_mode_of_which_one_promises_nothing_are_named():
    found = pj.diagnose(behind_a_slew_limit(3), ["slew_limit", "resonance", "delay"], levels=13)
    assert (found.verdict, set(found.effects)) == ("explained", {"slew_limit", "resonance"})
    values = {name: each for finding in found.findings for name, each in finding.parameters.items()}
    assert values["slew"].value == pytest.approx(480.0, rel=0.01)
    assert values["f_hz"].value == pytest.approx(80.0, rel=0.01)
    assert found.ladder[-1].rms_validation < 0.01 < found.ladder[0].rms_validation
    # What look calls not shown has no limit, and none is larger than the error without a word.
    assert all(
        limit.effect not in pj.look(found.steps[0].record).cannot_tell for limit in found.limits
    )
    assert all(
        limit.poorly_bounded == (limit.rms > found.ladder[-1].rms_validation)
        for limit in found.limits
        if limit.rms is not None
    )
