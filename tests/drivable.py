"""Models with given numbers, and courses for them, that tests of compensation share."""

import numpy as np
from exported import KINDS, model_with

import preisach_jax as pj
from preisach_jax.chain.coefficients import Coefficients
from preisach_jax.chain.description import Chain
from preisach_jax.operator.plane import Plane

RATE = 1000.0
PLANE = Plane(levels=11, low=0.0, high=10.0)
UNITS = {"input": "V", "output": "um"}
GOOD = 0.005  # held-out error of these models, of a stroke of 20


def played(seconds=2.0, **aux):
    """A record whose input has been through its range and ends in the middle of a small loop."""
    t = np.arange(round(seconds * RATE)) / RATE
    u = 5 - 5 * np.cos(np.pi * t * (1 + t))
    u[-500:] = 4 + 2 * np.cos(np.pi * np.arange(500) / 250)
    u[-700:-500] = np.linspace(u[-701], u[-500], 200)
    columns = {name: np.full(len(t), value) for name, value in aux.items()}
    units = UNITS | dict.fromkeys(columns, "N")
    return pj.Record.from_arrays(t, u, 2 * u, aux=columns, units=units, name="stage.csv")


def model_of(*effects, hysteron="ramp", sign=1, record=None, memory=0.0):
    """A model with given numbers: `(effect, values of its parameters, coefficients)` each."""
    rng = np.random.default_rng(1)
    weights = rng.uniform(0.1, 1.0, PLANE.cells)
    weights *= sign * 20 / weights.sum()
    kinds = tuple(effect for effect, _, _ in effects)
    chain = Chain(PLANE, kinds, hysteron, sign)
    values = {effect.name: own for effect, own, _ in effects}
    own = {effect.name: own for effect, _, own in effects}
    added = [x for name in dict.fromkeys(name for name, _ in chain.coefficients) for x in own[name]]
    coefficients = Coefficients(weights, memory * weights, 1.5, np.array(added))
    record = played() if record is None else record
    return model_with(chain, values, coefficients, record, ("t_s", "u_V", "z_um"), GOOD)


def resting_output(model, **aux):
    """The output when the drive has stayed for a while where the record ended."""
    t = model.origin.stop_s + np.arange(1, 1001) / RATE
    columns = {name: np.full(len(t), value) for name, value in aux.items()}
    u = np.full(len(t), model.origin.history[1, -1])
    return model.predict(pj.Record.from_arrays(t, u, u, aux=columns, units=UNITS)).output


def reading_of(model, drive):
    """What `predict` says of a drive that goes on from the record of the fit."""
    t = model.origin.stop_s + (1 + np.arange(len(drive))) / RATE
    return model.predict(pj.Record.from_arrays(t, drive, drive, units=UNITS)).output


def course(model, seconds=1.0, height=5.0, begin=None, **aux):
    """A smooth course of loops that begins at rest where the stage is."""
    t = np.arange(round(seconds * RATE)) / RATE
    start = resting_output(model, **aux)[: len(t)] if begin is None else begin
    blend = np.clip(t / 0.3, 0, 1)
    blend = blend**2 * (3 - 2 * blend)
    loops = 12 + height * np.sin(2 * np.pi * 2 * t) * np.cos(np.pi * t)
    columns = {name: np.full(len(t), value) for name, value in aux.items()}
    units = UNITS | dict.fromkeys(columns, "N")
    return pj.Record.from_arrays(
        t, 0 * t, start + (loops - start) * blend, aux=columns, units=units, name="wanted.csv"
    )


EFFECTS = {
    "creep": (KINDS["creep"](tau_s=(0.05, 0.5)), {"c_1": 0.05, "c_2": 0.08}, (0.1, -0.2)),
    "input_lag": (KINDS["input_lag"](), {"tau_s": 0.004}, ()),
    "output_lag": (KINDS["output_lag"](), {"tau_s": 0.004}, ()),
    "delay": (KINDS["delay"](), {"delay_s": 0.0033}, ()),
    "resonance": (KINDS["resonance"](), {"f_hz": 90.0, "zeta": 0.03}, ()),
    "slew_limit": (KINDS["slew_limit"](), {"slew": 500.0}, ()),
    "rate_dependence": (
        KINDS["rate_dependence"](reference_per_s=100.0, range_u=10.0),
        {"coefficient": 0.15, "exponent": 0.9},
        (),
    ),
    "moving": (KINDS["moving"](low_u=0.0, range_u=10.0, range_z=20.0), {"a": 0.1}, ()),
    "eddy_currents": (KINDS["eddy_currents"](range_u=10.0, speed_z=100.0), {"k": 0.004}, ()),
    "drift": (KINDS["drift"](horizon_s=2.0), {"tau_s": 1.0}, (0.4,)),
    "hum": (KINDS["hum"](harmonics=1), {"f_hz": 50.0}, (0.05, -0.03)),
    "ageing": (KINDS["ageing"](horizon_s=2.0), {"loss": 0.03, "tau_s": 2.0}, ()),
    "ageing_by_path": (
        KINDS["ageing"](horizon_s=80.0, by_path=True),
        {"loss": 0.1, "tau_s": 60.0},
        (),
    ),
    "drift_by_path": (KINDS["drift"](horizon_s=80.0, by_path=True), {"tau_s": 50.0}, (0.4,)),
    "operator_creep": (KINDS["operator_creep"](range_u=10.0), {}, (0.05, 0.01, 0.0) * 3),
    "reptation": (
        KINDS["reptation"](10.0),
        {"path": 30.0},
        (0.05,) * len(KINDS["reptation"]().coefficients()),
    ),
    "viscosity": (KINDS["viscosity"](), {"tau_s": 0.003}, (2e-3,)),
    "output_nonlinearity": (KINDS["output_nonlinearity"](1.5, 20.0), {}, (0.3, -0.2)),
}
