"""The arrays of a sweep on disk: Zarr, in chunks of seeds, each with a note that says it is whole.

Zarr keeps every chunk of an array in a file of its own, so that chunks are written apart, and any
reader of Zarr opens them. `done/seeds_0000-0007.json` is written after all arrays of its seeds, and
holds their checksum: without it, or if it does not fit, they do not count.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from preisach_jax.errors import InputError
from preisach_jax.files import json_bytes, write_files
from preisach_jax.sweep.result import Sweep

ARRAYS, DONE = "sweep.zarr", "done"

_ABOUT = ("first", "slope", "compile_s", "run_s", "device")


class Chunks:
    """The chunks of a sweep in a folder.

    Arguments:
        folder: the folder of the sweep.
        settings: its settings, as they stand in the manifest.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]):
        self.folder = folder
        self.settings = settings

    def __iter__(self) -> Iterator[list[int]]:
        """Numbers of the seeds of each chunk."""
        seeds, size = self.settings["seeds"], self.settings["chunk"]
        return iter([seeds[begin : begin + size] for begin in range(0, len(seeds), size)])

    def note(self, numbers: Sequence[int]) -> Path:
        """The file that says that a chunk is whole.

        Args:
            numbers: its seeds.
        """
        return self.folder / DONE / f"seeds_{numbers[0]:04d}-{numbers[-1]:04d}.json"

    def clear(self) -> None:
        """Let no chunk count any more."""
        for path in self.folder.glob(f"{DONE}/seeds_*.json"):
            path.unlink(missing_ok=True)

    def write(self, part: Sweep) -> None:
        """Write a chunk; it counts from when all of it is on the disk.

        Args:
            part: the sweep of its seeds.

        Raises:
            InputError: it cannot be written.
        """
        numbers = part.seeds.tolist()
        note = self.note(numbers)
        note.unlink(missing_ok=True)
        arrays = _arrays(part)
        try:
            group = self._group(arrays)
            for name, (axes, values, _) in arrays.items():
                group[name][self._place(axes, numbers)] = values
        except OSError as error:
            raise InputError(
                f"{self.folder / ARRAYS}: cannot be written ({error.strerror or error}); what was "
                "finished stays: make room, and give the same command again"
            ) from error
        about = {name: getattr(part, name) for name in _ABOUT}
        checksum = _checksum(values for _, values, _ in arrays.values())
        write_files({note: json_bytes({"seeds": numbers, **about, "checksum": checksum})})

    def read(self, numbers: list[int]) -> Sweep:
        """Read a chunk.

        Args:
            numbers: its seeds.

        Returns:
            The sweep of its seeds.

        Raises:
            InputError: it is missing or damaged.
        """
        note = self.note(numbers)
        try:
            about = json.loads(note.read_text(encoding="utf-8"))
            arrays = self._read(numbers)
            if about["seeds"] != numbers or about["checksum"] != _checksum(arrays.values()):
                raise ValueError("its arrays are not those that were written with it")
            found = {name: about[name] for name in _ABOUT}
        # Zarr and its codecs raise errors of many kinds on damaged files.
        except Exception as error:
            raise InputError(f"{note} or its part of {ARRAYS} cannot be read ({error})") from error
        levels = np.array(self.settings["levels"])
        return Sweep(
            levels=levels,
            noise_um=np.array(self.settings["noise"]),
            seeds=np.array(numbers),
            samples=self.settings["samples"],
            key=np.array(self.settings["key"], np.uint32),
            weights=tuple(arrays[f"weights_{N}"] for N in levels),
            **{name: arrays[name] for name in Sweep.AXES},
            **found,
        )

    def _read(self, numbers: list[int]) -> dict[str, np.ndarray]:
        import zarr

        group: Any = zarr.open_group(self.folder / ARRAYS, mode="r")
        found = {}
        for name in (*Sweep.AXES, *(f"weights_{N}" for N in self.settings["levels"])):
            array = group[name]
            found[name] = np.asarray(array[self._place(array.metadata.dimension_names, numbers)])
        return found

    def _place(self, axes: Sequence[str], numbers: Sequence[int]) -> tuple[slice, ...]:
        """Where the seeds of a chunk lie in an array with some axes."""
        begin = self.settings["seeds"].index(numbers[0])
        seeds = slice(begin, begin + len(numbers))
        return tuple(seeds if axis == "seed" else slice(None) for axis in axes)

    def _group(self, arrays: Mapping[str, tuple[tuple[str, ...], np.ndarray, str]]) -> Any:
        """The arrays on disk, with room for all seeds."""
        import zarr

        group: Any = zarr.open_group(self.folder / ARRAYS, mode="a")
        count = len(self.settings["seeds"])
        for name, (axes, values, unit) in arrays.items():
            seed = axes.index("seed")
            shape, chunks = list(values.shape), list(values.shape)
            shape[seed], chunks[seed] = count, self.settings["chunk"]
            there = group.get(name)
            if there is not None and there.shape != tuple(shape):  # more seeds than before
                there.resize(tuple(shape))
            if there is None:
                group.create_array(
                    name,
                    shape=tuple(shape),
                    chunks=tuple(chunks),
                    dtype=values.dtype,
                    dimension_names=axes,
                    attributes={"units": unit},
                    fill_value=np.nan if values.dtype.kind == "f" else -1,  # not yet computed
                )
        self._label(group)
        return group

    def _label(self, group: Any) -> None:
        """Write the coordinates of the axes, under the names of the axes, and the settings."""
        labels = {"level": ("levels", "1"), "noise": ("noise", "um"), "seed": ("seeds", "1")}
        for name, (setting, unit) in labels.items():
            values = np.array(self.settings[setting])
            there = group.get(name)
            if there is None or there.shape != values.shape:
                group.create_array(
                    name,
                    data=values,
                    dimension_names=(name,),
                    attributes={"units": unit},
                    overwrite=True,
                )
        group.attrs.update({"samples": self.settings["samples"], "key": self.settings["key"]})


def _arrays(part: Sweep) -> dict[str, tuple[tuple[str, ...], np.ndarray, str]]:
    """Axes, values and unit of all arrays of a sweep that have seeds."""
    found = {name: (axes, getattr(part, name), unit) for name, (axes, unit) in part.AXES.items()}
    for N, rows in zip(part.levels, part.weights, strict=True):
        found[f"weights_{N}"] = (("seed", "output", f"cell_{N}"), rows, "um")
    return found


def _checksum(arrays: Iterable[np.ndarray]) -> int:
    total = 0
    for values in arrays:
        total = zlib.crc32(values.tobytes(), total)
    return total
