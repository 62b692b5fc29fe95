"""The FMU is the model at its sample times, whatever the step, and its state can be kept."""

import shutil
import subprocess
import zipfile

import numpy as np
import pytest
from exported import GCC, STEP_S, STRICT, drawn, needs_compiler, predicted, smooth, wild

from preisach_jax.errors import InputError
from preisach_jax.export import export_fmu
from preisach_jax.export.fmu import IDENTIFIER, platform_tuple

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = [
    needs_compiler,
    # FMPy's own
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]
SAMPLES = 300


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """An FMU, the course of its inputs and what `predict` says to it."""
    model = drawn(["creep", "delay", "hum", "moving", "aux:load_N"], levels=5)
    [path] = export_fmu(model, tmp_path_factory.mktemp("fmu"))
    u, load = wild(SAMPLES, 2), smooth(SAMPLES, 5, 0.0, 1.0)
    return model, path, u, load, predicted(model, u, [load])


class Instance:
    """A simulation step by step, as a master runs it."""

    def __init__(self, path, folder):
        from fmpy.fmi3 import FMU3Slave

        self.description = fmpy.read_model_description(str(path))
        unpacked = fmpy.extract(str(path), unzipdir=str(folder))
        self.fmu = FMU3Slave(
            guid=self.description.guid, unzipDirectory=unpacked, instanceName="one",
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )  # fmt: skip
        self.fmu.instantiate()
        self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}

    def set(self, *values):
        names = [v.name for v in self.description.modelVariables if v.causality == "input"]
        self.fmu.setFloat64([self.reference[name] for name in names], list(values))

    def output(self):
        return self.fmu.getFloat64([self.reference["z"]])[0]

    def step(self, k, parts=1):
        for part in range(parts):
            self.fmu.doStep((k + part / parts) * STEP_S, STEP_S / parts)


@pytest.fixture
def instance(case, tmp_path):
    made = Instance(case[1], tmp_path)
    yield made
    made.fmu.terminate()
    made.fmu.freeInstance()


def test_fmpy_reports_no_problem(case):
    from fmpy.validation import validate_fmu

    model, path, *_ = case
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(str(path), validate=True)
    found = {v.name: (v.causality, v.unit) for v in description.modelVariables}
    assert found == {
        "time": ("independent", "s"),
        "u": ("input", "V"),
        "load_N": ("input", None),
        "z": ("output", "um"),
    }
    assert float(description.defaultExperiment.stepSize) == model.origin.step_s
    names = zipfile.ZipFile(path).namelist()
    assert f"binaries/{platform_tuple()}/{IDENTIFIER}.so" in names
    assert "sources/buildDescription.xml" in names


@pytest.mark.parametrize("parts", [1, 4])
def test_simulated_by_fmpy_it_is_predict(case, parts):
    """What FMPy records at the end of a step is the output at the inputs of its beginning."""
    _, path, u, load, expected = case
    time = np.arange(SAMPLES) * STEP_S
    kinds = [("time", float), ("u", float), ("load_N", float)]
    course = np.array(list(zip(time, u, load, strict=True)), dtype=kinds)
    result = fmpy.simulate_fmu(
        str(path), input=course, output=["z"], output_interval=STEP_S / parts, stop_time=time[-1]
    )
    found = result["z"][::parts]
    np.testing.assert_allclose(found[1:], expected[:-1], rtol=0, atol=1e-9 * np.ptp(expected))
    assert found[0] == pytest.approx(expected[0], abs=1e-12)


def test_a_master_that_sets_the_inputs_reads_the_output_at_them(case, instance):
    _, _, u, load, expected = case
    found = []
    for k in range(SAMPLES):
        instance.set(u[k], load[k])
        found.append(instance.output())
        assert instance.output() == found[-1]  # asking changes nothing
        instance.step(k, parts=3)
        assert instance.output() == found[-1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.ptp(expected))


def test_a_state_in_mid_course_is_come_back_to(case, instance):
    _, _, u, load, expected = case
    state = None
    for k in range(200):
        if k == 120:
            state = instance.fmu.getFMUState()
            state = instance.fmu.deserializeFMUState(instance.fmu.serializeFMUState(state))
        instance.set(u[k], load[k])
        instance.step(k)
    instance.fmu.setFMUState(state)
    for k in range(120, SAMPLES):
        instance.set(u[k], load[k])
        instance.step(k)
        assert instance.output() == pytest.approx(expected[k], abs=1e-9)
    instance.fmu.freeFMUState(state)
    instance.fmu.reset()
    instance.fmu.enterInitializationMode(startTime=0.0)
    instance.fmu.exitInitializationMode()
    instance.set(u[0], load[0])
    assert instance.output() == pytest.approx(expected[0], abs=1e-12)


def test_what_is_wrong_is_refused_and_changes_nothing(case, instance):
    _, _, u, load, expected = case
    instance.set(u[0], load[0])
    for reference, value in ((1, np.nan), (3, 1.0), (0, 1.0), (77, 1.0)):
        with pytest.raises(Exception, match="failed"):
            instance.fmu.setFloat64([2, reference], [9.0, value])
    with pytest.raises(Exception, match="failed"):
        instance.fmu.doStep(0.0, -1.0)
    with pytest.raises(Exception, match="failed"):
        instance.fmu.getFloat64([77])
    assert instance.output() == pytest.approx(expected[0], abs=1e-12)


def test_its_sources_hold_to_the_standard_of_the_c_export(case, tmp_path):
    zipfile.ZipFile(case[1]).extractall(tmp_path)
    subprocess.run(
        [GCC, *STRICT, "-DPREISACH_NO_ADAPT", "-fPIC", "-shared", "-o", tmp_path / "own.so",
         "fmi3_functions.c", "preisach_model.c", "-lm"], cwd=tmp_path / "sources", check=True,
    )  # fmt: skip


def test_without_a_compiler_the_remedy_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match=r"there is no C compiler .* --to c"):
        export_fmu(drawn([]), tmp_path / "none")
    assert not (tmp_path / "none").exists()
