"""A model as an FMU of FMI 3.0, for co-simulation: `preisach export --to fmu`."""

from __future__ import annotations

import hashlib
import io
import platform
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from preisach_jax.errors import InputError
from preisach_jax.export.c import sources, view
from preisach_jax.export.compiler import compiled
from preisach_jax.export.description import Description, describe
from preisach_jax.export.template import environment
from preisach_jax.files import file_name
from preisach_jax.model import Model

IDENTIFIER = "preisach_model"
LIBRARY = ("-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-DPREISACH_NO_ADAPT")

_VALUES = "const fmi3ValueReference references[], size_t count"
_KINDS = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
_ABSENT: dict[str, str] = {
    **{
        f"fmi3{way}{kind}": f"{_VALUES}, {constant}fmi3{kind} values[], size_t value_count"
        for kind in (*_KINDS, "Boolean", "String")
        for way, constant in (("Get", ""), ("Set", "const "))
    },
    "fmi3GetBinary": f"{_VALUES}, size_t sizes[], fmi3Binary values[], size_t value_count",
    "fmi3SetBinary": f"{_VALUES}, const size_t sizes[], const fmi3Binary values[], "
    "size_t value_count",
    "fmi3GetClock": f"{_VALUES}, fmi3Clock values[]",
    "fmi3SetClock": f"{_VALUES}, const fmi3Clock values[]",
    "fmi3GetNumberOfVariableDependencies": "fmi3ValueReference reference, size_t *count",
    "fmi3GetVariableDependencies": "fmi3ValueReference reference, size_t elements[], "
    "fmi3ValueReference independents[], size_t others[], fmi3DependencyKind kinds[], size_t count",
    **{
        f"fmi3Get{kind}Derivative": "const fmi3ValueReference unknowns[], size_t unknown_count, "
        "const fmi3ValueReference knowns[], size_t known_count, const fmi3Float64 seed[], "
        "size_t seed_count, fmi3Float64 sensitivity[], size_t sensitivity_count"
        for kind in ("Directional", "Adjoint")
    },
    "fmi3GetIntervalDecimal": f"{_VALUES}, fmi3Float64 intervals[], "
    "fmi3IntervalQualifier qualifiers[]",
    "fmi3GetIntervalFraction": f"{_VALUES}, fmi3UInt64 counters[], fmi3UInt64 resolutions[], "
    "fmi3IntervalQualifier qualifiers[]",
    "fmi3GetShiftDecimal": f"{_VALUES}, fmi3Float64 shifts[]",
    "fmi3GetShiftFraction": f"{_VALUES}, fmi3UInt64 counters[], fmi3UInt64 resolutions[]",
    "fmi3SetIntervalDecimal": f"{_VALUES}, const fmi3Float64 intervals[]",
    "fmi3SetIntervalFraction": f"{_VALUES}, const fmi3UInt64 counters[], "
    "const fmi3UInt64 resolutions[]",
    "fmi3SetShiftDecimal": f"{_VALUES}, const fmi3Float64 shifts[]",
    "fmi3SetShiftFraction": f"{_VALUES}, const fmi3UInt64 counters[], "
    "const fmi3UInt64 resolutions[]",
    "fmi3EnterContinuousTimeMode": "",
    "fmi3CompletedIntegratorStep": "fmi3Boolean no_set, fmi3Boolean *event, fmi3Boolean *terminate",
    "fmi3SetTime": "fmi3Float64 time",
    "fmi3SetContinuousStates": "const fmi3Float64 states[], size_t count",
    **{
        f"fmi3Get{kind}": "fmi3Float64 values[], size_t count"
        for kind in (
            "ContinuousStateDerivatives", "EventIndicators", "ContinuousStates",
            "NominalsOfContinuousStates",
        )
    },
    "fmi3GetNumberOfEventIndicators": "size_t *count",
    "fmi3GetNumberOfContinuousStates": "size_t *count",
    "fmi3GetOutputDerivatives": f"{_VALUES}, const fmi3Int32 orders[], fmi3Float64 values[], "
    "size_t value_count",
    "fmi3ActivateModelPartition": "fmi3ValueReference clock, fmi3Float64 time",
}  # fmt: skip
"""Functions of the standard that a co-simulation of real numbers does not have."""


def fmu_archive(model: Model, rate_hz: float | None = None, without: Sequence[str] = ()) -> bytes:
    """The content of an FMU: description, sources and this platform's binary."""
    described = describe(model, rate_hz, without)
    texts = _texts(described, model.columns["time"])
    sources_of_it = {name: text for name, text in texts.items() if name.startswith("sources/")}
    with tempfile.TemporaryDirectory() as folder:
        binary = compiled(sources_of_it, LIBRARY, folder).read_bytes()
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    contents = {name: text.encode() for name, text in texts.items()}
    contents[f"binaries/{platform_tuple()}/{IDENTIFIER}{suffix}"] = binary
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in contents.items():
            # A fixed date: one model gives one file.
            packed.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content)
    return archive.getvalue()


def fmu_name(model: Model) -> str:
    """File name of a model's FMU, after its record."""
    return f"{file_name(Path(model.origin.record).stem) or IDENTIFIER}.fmu"


def platform_tuple() -> str:
    """This platform as FMI 3.0 names it, such as `x86_64-linux`."""
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    return f"{machine}-{system}"


def _texts(model: Description, time_name: str) -> dict[str, str]:
    columns = (model.input, *model.aux)
    names = [column.name for column in (*columns, model.output)]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(
                f"two columns of the model have the name {name!r}, and variables of an FMU must "
                "differ: fit the model anew with other names"
            )
    time_name = "time" if "time" not in names else time_name
    while time_name in names:
        time_name += "_"
    code = sources(model)
    step = repr(model.step_s)
    starts = [model.low, *[0.0] * len(model.aux)]
    units = dict.fromkeys(["s", *(c.unit for c in (*columns, model.output) if c.unit)])
    content: dict[str, Any] = view(model) | {
        "identifier": IDENTIFIER,
        "name": Path(model.record).stem or IDENTIFIER,
        "version": version("preisach_jax"),
        "token": hashlib.sha256("".join(code.values()).encode()).hexdigest(),
        "step": step,
        "time_name": time_name,
        "inputs": [
            {"name": column.name, "unit": column.unit, "start": repr(start)}
            for column, start in zip(columns, starts, strict=True)
        ],
        "starts": ", ".join(repr(start) for start in starts),
        "units": list(units),
        "step_arguments": "".join(
            f", (preisach_real)simulation->inputs[{k}]" for k in range(len(columns))
        ),
        "absent": [(name, _parameters(text)) for name, text in _ABSENT.items()],
    }
    code["fmi3_functions.c"] = environment().get_template("fmi3_functions.c.j2").render(content)
    xml = environment().overlay(autoescape=True)
    described = {
        "modelDescription.xml": xml.get_template("modelDescription.xml.j2").render(content),
        "sources/buildDescription.xml": xml.get_template("buildDescription.xml.j2").render(content),
    }
    return described | {f"sources/{name}": text for name, text in code.items()}


def _parameters(text: str) -> dict[str, str]:
    """Parameters of a function, and statements that use none of them."""
    names = [part.split()[-1].strip("*[]") for part in text.split(",") if part]
    return {
        "parameters": f", {text}" if text else "",
        "unused": " ".join(f"(void){name};" for name in names),
    }
