"""A place to drop a file or to choose one, from which its bytes come in pieces."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from typing import Any

import panel as pn
import param

from preisach_jax.app import panels
from preisach_jax.errors import InputError


class Dropper(pn.custom.JSComponent):
    """A box that takes one file after the other; the browser sends each as soon as it is there.

    Panel's own widget keeps every file for a second and a half before it sends it, and shows it
    until it is taken away.

    Attributes:
        text: what stands in the box.
        hint: what stands below that, while the box is not compact.
        most_bytes: size of the greatest file that is sent.
        compact: whether the box is one line high.
        whole_page: whether a file may be dropped anywhere on the page.
        several: whether several files may be dropped or chosen at once.
    """

    text: Any = param.String()
    hint: Any = param.String()
    most_bytes: Any = param.Integer()
    compact: Any = param.Boolean()
    whole_page: Any = param.Boolean()
    several: Any = param.Boolean()

    _esm = files("preisach_jax.app").joinpath("dropper.js").read_text(encoding="utf-8")

    def __init__(
        self,
        on_file: Callable[[str, bytes], None],
        refused: Callable[[Exception], None],
        most_bytes: int,
        text: str,
        **options: Any,
    ):
        """Make a box."""
        self._on_file, self._refused = on_file, refused
        self._number, self._pieces = 0, list[bytes]()
        super().__init__(
            text=text, most_bytes=most_bytes, stylesheets=[panels.style()],
            sizing_mode="stretch_width", margin=(4, 8), **options,
        )  # fmt: skip

    def _handle_msg(self, data: Any) -> None:
        """Take a piece of a file; the pieces of one that came before are let go."""
        name, size = str(data["name"]), int(data["size"])
        if size > self.most_bytes:
            self._refused(
                InputError(
                    f"{name} has {size / 1e6:.0f} MB; the page takes {self.most_bytes / 1e6:.0f} "
                    "MB at most: use the command line, 'preisach diagnose FILE'"
                )
            )
            return
        if data["number"] != self._number:
            self._number, self._pieces = data["number"], []
        self._pieces.append(bytes(data["data"]))
        if sum(map(len, self._pieces)) >= size:
            content, self._pieces = b"".join(self._pieces), []
            self._number = 0
            self._on_file(name, content)
