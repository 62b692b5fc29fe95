"""Small valid files of every kind that the package reads, from which a campaign starts."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

ROWS = 60


def readable_files(reader: str) -> list[bytes]:
    """Valid files of a reader.

    Arguments:
        reader: a name in `SEEDS`.

    Returns:
        The content of each.

    Example:
        >>> [content[:3] for content in readable_files("delimited")][0]
        b't_s'
    """
    return list(SEEDS[reader]())


def columns() -> dict[str, np.ndarray]:
    """Time, input and output of a small record, with an auxiliary column."""
    t = np.arange(ROWS) / 20
    u = 5 - 5 * np.cos(t * (1 + t / 4))
    return {"t_s": t, "u_V": u, "z_um": u**1.1 + 0.01 * t, "load_N": np.sin(3 * t)}


def _delimited() -> Iterator[bytes]:
    arrays = columns()
    names, body = list(arrays), list(zip(*arrays.values(), strict=True))

    def text(delimiter, head, decimal=".", first=str):
        rows = [
            delimiter.join([first(row[0]), *(f"{value:.6g}" for value in row[1:])]) for row in body
        ]
        return head + "\n" + "\n".join(rows).replace(".", decimal) + "\n"

    yield text(",", ",".join(names)).encode()
    german = text(";", "Zeit [s];Spannung [V];Weg [µm];Last [N]", ",")
    yield german.encode()
    yield german.encode("cp1252")
    yield german.encode("utf-16")
    yield text("\t", "t\tu\tz\tload\n-\tV\tum\t[N]").encode("utf-8-sig")
    yield text(" ", "# a stage\n# t u z load").encode()
    yield text("|", "Logger 3\nSerial 17\nt_ms|u_V|z_um|load_N").replace("\n", "\r\n").encode()
    yield text(",", "1,2,3,4").encode()
    yield text(",", '"t_s","u_V","z, um","load_N"').replace(",0.1", ',"0.1"').encode()
    for clock in (
        lambda t: f"12:00:{t:06.3f}",
        lambda t: f"2024-03-01T12:00:{t:06.3f}Z",
        lambda t: f"01.03.2024 12:00:{t:06.3f}",
        lambda t: f"{1700000000 + t:.3f}",
        lambda t: f"{int(1.7e18 + t * 1e9)}",
    ):
        yield text(",", "time,u_V,z_um,load_N", first=clock).encode()
    yield text(",", ",".join(names)).replace(",0.", ",").replace("\n0.5,", "\n,").encode()


def _micromag() -> Iterator[bytes]:
    head = (
        "MicroMag 2900/3900 Data File (Series 0015)\nFirst-order reversal curves\n"
        "Configuration   :  VSM\nAveraging time = +1.0000E-01\nHCal = +2.0000E-01\n"
        "HSat = +3.0000E-01\nPauseSat = +1.0000E+00\nElapsed time = +5.0000E+02\n"
        "Units of measure : {units}\nNData = {count}\n\n"
    )
    blocks, count = [], 0
    for reversal in np.linspace(0.2, -0.2, 8):
        blocks.append("+2.000000E-01,+1.000000E-05")
        fields = np.arange(reversal, 0.25, 0.05)
        blocks.append("\n".join(f"{h:+.6E},{np.tanh(9 * h) * 1e-5:+.6E}" for h in fields))
        count += 1 + len(fields)
    body = "\n\n".join(blocks) + "\n\nMicroMag 2900/3900 Data File ends\n"
    yield (head.format(units="Hybrid SI", count=count) + body).encode()
    yield (head.format(units="cgs", count=count) + body).replace(" = ", "    ").encode()
    yield (head.format(units="cgs", count="N/A") + body).replace("\n", "\r\n").encode()


def _npz() -> Iterator[bytes]:
    arrays: dict[str, Any] = dict(columns())
    dates = np.datetime64("2024-03-01") + (arrays["t_s"] * 1e9).astype("timedelta64[ns]")
    for saved in (np.savez, np.savez_compressed):
        for content in (
            arrays,
            arrays | {"t_s": dates},
            arrays | {"t_s": dates - dates[0], "more": np.eye(3), "one": np.float64(3.0)},
            arrays | {"t_s": np.arange(ROWS) + 1_700_000_000_000, "name": np.array(["a"] * ROWS)},
            arrays | {"on": arrays["u_V"] > 3, "c": 1j * arrays["u_V"], "u_V": np.arange(ROWS)},
            {"table": np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")]), **arrays},
            {name: values.astype(np.float32)[None] for name, values in arrays.items()},
        ):
            file = io.BytesIO()
            saved(file, **content)
            yield file.getvalue()


def _mat() -> Iterator[bytes]:
    from scipy.io import savemat

    arrays = columns()
    nested = {"run": {"t": arrays["t_s"], "u": arrays["u_V"], "z": arrays["z_um"]}, "note": "hi"}
    cells = {"c": np.array([1, "a", np.eye(2)], dtype=object), **arrays}
    for compress in (False, True):
        for content in (arrays, nested, cells):
            file = io.BytesIO()
            savemat(file, content, do_compression=compress)
            yield file.getvalue()
    file = io.BytesIO()
    savemat(file, arrays, format="4")
    yield file.getvalue()


def _parquet() -> Iterator[bytes]:
    import pyarrow as pa
    from pyarrow import parquet

    arrays: dict[str, Any] = dict(columns())
    dates = np.datetime64("2024-03-01") + (arrays["t_s"] * 1e9).astype("timedelta64[ns]")
    for content in (
        arrays,
        arrays | {"t_s": dates},
        arrays | {"label": [["a"], None] * (ROWS // 2), "t_s": np.arange(ROWS) + 10**12},
        {name: values.astype(np.float32) for name, values in arrays.items()},
        arrays | {"u_V": [None, 1.5] * (ROWS // 2), "b": arrays["u_V"] > 3},
    ):
        for options in ({"compression": "none"}, {"compression": "gzip", "row_group_size": 25}):
            file = io.BytesIO()
            parquet.write_table(pa.table(content), file, **options)
            yield file.getvalue()


def model_content() -> dict[str, Any]:
    """The content of a model file with an effect of every place, made without a fit."""
    from preisach_jax.chain import Chain, Coefficients
    from preisach_jax.effects.ageing import Ageing
    from preisach_jax.effects.auxiliary import Auxiliary
    from preisach_jax.effects.creep import Creep
    from preisach_jax.effects.drift import Drift
    from preisach_jax.effects.input_lag import InputLag
    from preisach_jax.effects.output_nonlinearity import OutputNonlinearity
    from preisach_jax.effects.rate_dependence import RateDependence
    from preisach_jax.model import Model, Origin, ParameterEstimate
    from preisach_jax.operator.plane import Plane
    from preisach_jax.record import Record

    arrays = columns()
    effects = (
        InputLag(),
        RateDependence(with_corners=True),
        Ageing(),
        Creep(tau_s=(0.1, 1.0)),
        Drift(),
        Auxiliary(column="load_N", unit="N"),
        OutputNonlinearity(),
    )
    chain = Chain(Plane(levels=3, low=0.0, high=10.0), effects)

    def estimate(p):
        low, high = max(p.low, -1e3), min(p.high, 1e3)
        value = p.start[0] if low <= p.start[0] <= high else (low + high) / 2
        return ParameterEstimate(float(value), float("-inf"), float(value) * 2, p.unit)

    parameters = {
        effect.name: {p.name: estimate(p) for p in effect.parameters()} for effect in effects
    }
    for effect, coefficient in chain.coefficients:
        parameters[effect][coefficient.name] = estimate(coefficient)
    names = {"time": "t_s", "input": "u_V", "output": "z_um", "aux": ["load_N"]}
    record = Record.from_arrays(
        arrays["t_s"], arrays["u_V"], arrays["z_um"], aux={"load_N": arrays["load_N"]}
    )
    model = Model(
        chain=chain,
        values={e: {p: got.value for p, got in inner.items()} for e, inner in parameters.items()},
        coefficients=Coefficients(
            np.arange(6.0) + 0.5,
            np.arange(6.0) / 10,
            0.25,
            np.array([parameters[e][p.name].value for e, p in chain.coefficients]),
            np.linspace(0, 1, 6),
        ),
        parameters=parameters,
        visited=np.array([True] * 5 + [False]),
        columns=names,
        units={"time": "s", "input": "V", "output": "um", "load_N": "N"},
        origin=Origin.of(record),
        rms_validation=0.02,
        noise=0.01,
    )
    return model.to_json()


def _model() -> Iterator[bytes]:
    from preisach_jax.files import plain_json

    content = plain_json(model_content())
    yield json.dumps(content).encode()
    yield json.dumps(content | {"effects": [], "hysteron": "relay"}, indent=1).encode()


SEEDS: dict[str, Callable[[], Iterator[bytes]]] = {
    "delimited": _delimited,
    "micromag": _micromag,
    "npz": _npz,
    "mat": _mat,
    "parquet": _parquet,
    "model": _model,
}
"""What makes the files of each reader, by its name."""

ENDINGS = {
    "delimited": ".csv",
    "micromag": ".forc",
    "npz": ".npz",
    "mat": ".mat",
    "parquet": ".parquet",
    "model": ".json",
}
"""How the name of a file ends for a reader to be chosen."""
