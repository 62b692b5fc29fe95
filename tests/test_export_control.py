"""The system of python-control has the outputs of `predict`, and its states begin at zero."""

import sys

import numpy as np
import pytest
from exported import STEP_S, drawn, predicted, smooth, wild

from preisach_jax.errors import InputError

EFFECTS = "creep slew_limit rate_corners_all eddy_currents delay drift hum aux:load_N".split()


@pytest.fixture(scope="module")
def control():
    return pytest.importorskip("control", reason="python-control is not installed")


def test_the_response_is_that_of_predict(control):
    model = drawn(EFFECTS, levels=5)
    system = model.to_control(name="stage")
    u, load = wild(100, 3), smooth(100, 4, 0.0, 1.0)
    time = np.arange(len(u)) * STEP_S
    found = np.ravel(control.input_output_response(system, time, np.stack([u, load])).outputs)
    expected = predicted(model, u, [load])
    np.testing.assert_allclose(found[1:], expected[1:], rtol=0, atol=1e-12 * np.ptp(expected))
    assert system.name == "stage"
    assert system.input_labels == ["u", "load_N"]
    assert system.output_labels == ["z"]
    assert system.dt == STEP_S
    assert sum(label.startswith("low[") for label in system.state_labels) == model.plane.cells


def test_without_the_package_the_extra_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"pip install 'preisach_jax\[control\]'"):
        drawn([]).to_control()
