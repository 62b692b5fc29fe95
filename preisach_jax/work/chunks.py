"""Long work in a folder, in chunks, each written as it is done: an interruption loses little.

A folder holds `manifest.json` (the settings) and a Zarr group of arrays with `done/`, which says
what of them is whole. Zarr keeps every chunk of an array in a file of its own, so that chunks are
written apart, and any reader of Zarr opens them. `done/seeds_0000-0007.json` is written after all
arrays of its seeds, and holds their checksum: without it, or if it does not fit, they do not count.

Zarr's own `crc32c` tells a damaged chunk, but not one of another run under the same name; the
checksum here covers all arrays of a chunk together.

Of several processes the first one alone reads and writes the folder; all compute every chunk.
"""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from preisach_jax.errors import ContentError, InputError
from preisach_jax.files import json_bytes, write_files

MANIFEST, DONE = "manifest.json", "done"


class Values(NamedTuple):
    """An array of a chunk, or of all of the work.

    Attributes:
        axes: names of its axes; one of them is that of the items.
        values: the numbers.
        unit: their unit.
    """

    axes: tuple[str, ...]
    values: np.ndarray
    unit: str = "1"


class Chunks:
    """The chunks of some work in a folder.

    Arguments:
        folder: the folder.
        work: what it is, as `sweep`, which names the arrays' folder.
        item: what a chunk holds several of, as `seed`.
        settings: those of the work; with all items, in order, under the plural of `item`, and how
            many of them make a `chunk`.
        numbers: of the items; by default 0, 1, ...
        labels: coordinates of the axes, which are written with the arrays.
        about: what else is written with them, ready for JSON.
    """

    def __init__(
        self,
        folder: Path,
        work: str,
        item: str,
        settings: Mapping[str, Any],
        numbers: Sequence[int] | None = None,
        labels: Mapping[str, Values] | None = None,
        about: Mapping[str, Any] | None = None,
    ):
        self.folder: Path = folder
        self.work: str = work
        self.item: str = item
        self.settings: Mapping[str, Any] = settings
        self.numbers: list[int] = list(
            range(len(settings[f"{item}s"])) if numbers is None else numbers
        )
        self.labels: Mapping[str, Values] = labels or {}
        self.about: Mapping[str, Any] = about or {}

    def __iter__(self) -> Iterator[list[int]]:
        """Numbers of the items of each chunk."""
        size = self.settings["chunk"]
        begins = range(0, len(self.numbers), size)
        return iter([self.numbers[begin : begin + size] for begin in begins])

    @property
    def arrays(self) -> Path:
        """The folder of the arrays."""
        return self.folder / f"{self.work}.zarr"

    def note(self, numbers: Sequence[int]) -> Path:
        """The file that says that a chunk is whole.

        Arguments:
            numbers: its items.
        """
        return self.folder / DONE / f"{self.item}s_{numbers[0]:04d}-{numbers[-1]:04d}.json"

    def clear(self) -> None:
        """Delete all chunks."""
        for path in self.folder.glob(f"{DONE}/{self.item}s_*.json"):
            path.unlink(missing_ok=True)
        shutil.rmtree(self.arrays, ignore_errors=True)

    def write(
        self, numbers: Sequence[int], arrays: Mapping[str, Values], about: Mapping[str, Any]
    ) -> None:
        """Write a chunk; it counts from when all of it is on the disk.

        Arguments:
            numbers: its items.
            arrays: by names.
            about: what else is known of it, ready for JSON.

        Raises:
            InputError: it cannot be written.
        """
        note = self.note(numbers)
        try:
            note.unlink(missing_ok=True)
            group = self._group(arrays)
            for name, (axes, values, _) in arrays.items():
                group[name][self._place(axes, numbers)] = values
        except OSError as error:
            raise InputError(
                f"{self.arrays}: cannot be written ({error.strerror or error}); what was "
                "finished stays: make room, and give the same command again"
            ) from error
        checksum = _checksum(each.values for each in arrays.values())
        content = {f"{self.item}s": list(numbers), **about, "checksum": checksum}
        write_files({note: json_bytes(content)})

    def read(
        self, numbers: Sequence[int], names: Iterable[str]
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Read a chunk.

        Arguments:
            numbers: its items.
            names: of its arrays, in the order in which they were written.

        Returns:
            `(arrays, about)`.

        Raises:
            InputError: it is missing or damaged.
        """
        note = self.note(numbers)
        try:
            about = json.loads(note.read_text(encoding="utf-8"))
            arrays = self._read(numbers, names)
            fits = about.pop("checksum") == _checksum(arrays.values())
            if about.pop(f"{self.item}s") != list(numbers) or not fits:
                raise ContentError("its arrays are not those that were written with it")
        # Zarr and its codecs raise errors of many kinds on damaged files.
        except Exception as error:
            raise InputError(
                f"{note} or its part of {self.arrays.name} cannot be read ({error}); remove it "
                "to compute it again"
            ) from error
        return arrays, about

    def _read(self, numbers: Sequence[int], names: Iterable[str]) -> dict[str, np.ndarray]:
        import zarr

        group: Any = zarr.open_group(self.arrays, mode="r")
        found: dict[str, np.ndarray] = {}
        for name in names:
            array = group[name]
            found[name] = np.asarray(array[self._place(array.metadata.dimension_names, numbers)])
        return found

    def _place(self, axes: Sequence[str], numbers: Sequence[int]) -> tuple[slice, ...]:
        """Where the items of a chunk lie in an array with some axes."""
        begin = self.numbers.index(numbers[0])
        items = slice(begin, begin + len(numbers))
        return tuple(items if axis == self.item else slice(None) for axis in axes)

    def _group(self, arrays: Mapping[str, Values]) -> Any:
        """The arrays on disk, with room for all items."""
        group = self._open_or_begin()
        for name, (axes, values, unit) in arrays.items():
            own = axes.index(self.item)
            shape, chunks = list(values.shape), list(values.shape)
            shape[own], chunks[own] = len(self.numbers), self.settings["chunk"]
            there = self._array(group, name)
            if there is not None and there.shape != tuple(shape):  # more items than before
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
        for name, (axes, values, unit) in self.labels.items():
            there = self._array(group, name)
            if there is None or there.shape != values.shape:
                attributes = {"units": unit}
                group.create_array(
                    name, data=values, dimension_names=axes, attributes=attributes, overwrite=True
                )
        items = f"{self.item}s"
        group.attrs.update({name: v for name, v in self.settings.items() if name != items})
        group.attrs.update(self.about)
        return group

    # What describes the arrays may be damaged when the machine went down. The checksums of the
    # chunks do not fit then; all are computed again, and need a sound place.

    def _open_or_begin(self) -> Any:
        """The group on disk; one that cannot be read is begun anew."""
        import zarr

        try:
            return zarr.open_group(self.arrays, mode="a")
        except OSError:
            raise
        except Exception:
            shutil.rmtree(self.arrays)
            return zarr.open_group(self.arrays, mode="a")

    def _array(self, group: Any, name: str) -> Any:
        """An array on disk, None if there is none; one that cannot be read is removed."""
        try:
            return group.get(name)
        except OSError:
            raise
        except Exception:
            shutil.rmtree(self.arrays / name)
            return None


def _checksum(arrays: Iterable[np.ndarray]) -> int:
    total = 0
    for values in arrays:
        total = zlib.crc32(values.tobytes(), total)
    return total
