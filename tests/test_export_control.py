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
    system = model.to_control()
    u, load = wild(100, 3), smooth(100, 4, 0.0, 1.0)
    time = np.arange(len(u)) * STEP_S
    found = np.ravel(control.input_output_response(system, time, np.stack([u, load])).outputs)
    expected = predicted(model, u, [load])
    np.testing.assert_allclose(found[1:], expected[1:], rtol=0, atol=1e-12 * np.ptp(expected))
    assert system.input_labels == ["u", "load_N"]
    assert system.output_labels == ["z"]
    assert system.dt == STEP_S
    assert sum(label.startswith("low[") for label in system.state_labels) == model.plane.cells


def test_it_can_be_connected(control):
    """An integrator closes the loop around it: the output comes to what is wanted."""
    model = drawn([])
    stage = model.to_control(name="stage")
    gain = 0.2
    controller = control.NonlinearIOSystem(
        lambda t, x, u, params: x + gain * (u[0] - u[1]),
        lambda t, x, u, params: x,
        inputs=["wanted", "z"], outputs=["u"], states=1, dt=STEP_S, name="controller",
    )  # fmt: skip
    loop = control.interconnect([stage, controller], inputs=["wanted"], outputs=["z"])
    wanted = 0.25 + 0.6 * float(model.weights.sum())
    time = np.arange(400) * STEP_S
    found = control.input_output_response(loop, time, np.full(400, wanted)).outputs
    assert abs(found[-1] - wanted) < 1e-3
    assert abs(found[0] - wanted) > 0.1


def test_without_the_package_the_extra_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match=r"pip install 'preisach_jax\[control\]'"):
        drawn([]).to_control()
