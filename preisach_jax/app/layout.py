"""The widgets of the page and where they stand, at every width of the window."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from importlib.resources import files
from typing import Any

import panel as pn
import param

from preisach_jax.app import panels
from preisach_jax.app.upload import MOST_BYTES
from preisach_jax.app.views import AXES, NARROW
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


LEVELS = {"25 levels, finer where it pays": 0, "13 levels": 13, "38 levels": 38, "50 levels": 50}
"""Levels of the plane by what the menu calls them; 0 leaves them to the fit."""

_DARK = """
const root = document.documentElement
root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark"
"""

_HEAD = """
:host { min-width: 0 !important; gap: 0.3rem; padding: 0.3rem 0.8rem; align-items: center;
  flex-wrap: wrap !important; border-bottom: 1px solid var(--line); }
"""
_BODY = f"""
:host {{ min-width: 0 !important; height: calc(100vh - 3.6rem) !important; align-items: stretch; }}
{NARROW} {{ :host {{ display: block !important; height: auto !important; }} }}
"""
_MAIN = f"""
:host {{ flex: 1 1 0 !important; min-width: 0 !important; height: 100%;
  overflow-y: auto; padding: 0 0.5rem; }}
{NARROW} {{ :host {{ display: block !important; width: 100% !important; max-width: 100vw;
  height: auto !important; overflow: visible; padding: 0 0.6rem;
  box-sizing: border-box; }} }}
"""
_SIDE = f"""
:host {{ flex: 0 0 25rem !important; max-width: 25rem; min-width: 0 !important; height: 100%;
  overflow-y: auto; padding: 0 0.4rem; border-left: 1px solid var(--line); }}
{NARROW} {{ :host {{ display: block !important; width: 100% !important; max-width: 100vw;
  height: auto !important; overflow: visible;
  padding: 0 0.4rem; box-sizing: border-box; border-left: 0; }} }}
"""
BLOCK = ":host { display: block !important; height: auto !important; min-width: 0 !important; }"
_AWAY = ":host(.away) { display: none !important; }"
"""Style of what can be away: the styles of boxes outdo what hides them."""

_FOLDED = NARROW + " { :host(.folded) { display: none !important; } }"
_FOLD = f"""
:host {{ display: none !important; }}
{NARROW} {{ :host(.known) {{ display: inline-block !important; flex: 0 0 auto !important; }} }}
"""
"""Style of the columns and of their button: on a phone they are away once they are known."""

_BESIDE = f"""
:host {{ min-width: 0 !important; gap: 0.6rem; align-items: flex-start; }}
{NARROW} {{ :host {{ display: block !important; height: auto !important; }} }}
"""
_FILES = ":host { align-items: center; min-width: 0 !important; }"
WRAP = ":host { flex-wrap: wrap !important; gap: 0.4rem; min-width: 0 !important; }"
_CARD = ":host { border: 1px solid var(--line); border-radius: 8px; padding: 0.3rem 0.4rem; " \
    "margin: 0.25rem 0.4rem; background: var(--paper); }"  # fmt: skip


class Layout:
    """All that the page shows, without what it does.

    Attributes:
        view: the whole page.
    """

    def __init__(self, on: dict[str, Callable[..., None]]):
        self.dropper = Dropper(
            on["drop"], on["refuse"], MOST_BYTES, panels.DROP_HERE, hint=panels.KINDS,
            whole_page=True,
        )  # fmt: skip
        self.message = panels.pane()
        self.doing = panels.pane()
        self.file = panels.pane(panels.brand(""))
        self.verdict = panels.pane()
        self.chips = pn.Column(sizing_mode="stretch_width", stylesheets=[BLOCK, _FOLDED])
        self.fold = button("Columns", on["fold"])
        self.fold.stylesheets = [*self.fold.stylesheets, _FOLD]
        self.steps = pn.Row(sizing_mode="stretch_width", stylesheets=[WRAP])
        self.levels = styled(pn.widgets.Select(label="Preisach plane", options=LEVELS, width=250))
        self.levels.param.watch(on["levels"], "value")
        self.fit = button("Fit", on["fit"], "primary")
        self.find = button("Find it for me", on["find"], "primary")
        self.form = button("Look for a form", on["form"])
        self.form.visible = False  # until something remains unexplained
        self.undo = button("Undo", on["undo"])
        self.cancel = button("Cancel", on["cancel"])
        self.dark = styled(pn.widgets.Button(label="Dark or light", color="default"))
        self.dark.js_on_click(code=_DARK)
        self.save = button("Save project", on["save"])
        self.axis = styled(
            pn.widgets.Select(
                label="Residual against",
                options={text: key for key, text in AXES.items()},
                width=230,
                visible=False,  # until there is a residual
            )
        )
        self.axis.param.watch(on["axis"], "value")
        self.shown = styled(
            pn.widgets.RadioButtonGroup(
                label="View", options=["Record", "Drive", "Compare"], value="Record"
            )
        )
        self.shown.param.watch(on["shown"], "value")
        self.ladder = panels.pane()
        self.advice = panels.pane()
        self.cards = pn.Column(sizing_mode="stretch_width")
        self.prepare = button("Prepare export", on["export"])
        self.downloads = pn.Column(sizing_mode="stretch_width")
        self.project = pn.Column(sizing_mode="stretch_width")
        self.facts = panels.facts_pane()
        self.first = beside()
        self.first.stylesheets = [*self.first.stylesheets, _AWAY]
        show(self.first, False)
        self.preview = panels.pane()
        self.record = pn.Column(
            self.first, self.preview, sizing_mode="stretch_width", stylesheets=[BLOCK, _AWAY]
        )
        self.drawn = pn.Column(sizing_mode="stretch_width", stylesheets=[BLOCK])
        self.view: Any = self._arranged()

    def place_record(self, drawn: Any) -> None:
        """Give the figures of a record their place, beside what a look finds in it."""
        self.first.objects = [plots(drawn), self.facts]

    def fold_columns(self, are_known: bool, are_folded: bool) -> None:
        """Put the columns away where the window is narrow, and offer them again."""
        self.fold.css_classes = ["known"] if are_known else []
        self.fold.label = "Columns" if are_folded else "Hide columns"
        self.chips.css_classes = ["folded"] if are_folded else []

    def _arranged(self) -> Any:
        head = pn.Row(
            self.file, self.save, self.dark, sizing_mode="stretch_width", stylesheets=[_HEAD]
        )
        views = pn.Row(self.shown, self.axis, sizing_mode="stretch_width", stylesheets=[WRAP])
        files = pn.Row(self.dropper, self.fold, sizing_mode="stretch_width", stylesheets=[_FILES])
        main = pn.Column(
            files, self.message, self.chips, self.verdict, self.doing, self.steps, views,
            self.record, self.drawn, sizing_mode="stretch_both", stylesheets=[_MAIN],
        )  # fmt: skip
        buttons = pn.Row(
            self.fit, self.find, self.form, self.undo, self.cancel, sizing_mode="stretch_width",
            stylesheets=[WRAP],
        )  # fmt: skip
        side = pn.Column(
            panels.pane(panels.heading("What may be missing")),
            self.advice, buttons, self.cards,
            panels.pane(panels.heading("The model")),
            self.ladder, self.levels,
            panels.pane(panels.heading("Download")),
            self.prepare, self.downloads, self.project,
            stylesheets=[_SIDE],
        )  # fmt: skip
        body = pn.Row(main, side, sizing_mode="stretch_both", stylesheets=[_BODY])
        sheets = [BLOCK, panels.page_style()]
        return pn.Column(head, body, sizing_mode="stretch_width", stylesheets=sheets)


def plots(drawn: Any) -> Any:
    """Figures that fill what the window leaves."""
    return pn.pane.Bokeh(drawn, sizing_mode="stretch_both")


def show(box: Any, is_shown: bool) -> None:
    """Show a box that can be away, or hide it."""
    box.visible = is_shown
    box.css_classes = [] if is_shown else ["away"]


def beside(*parts: Any) -> Any:
    """Parts side by side, on a phone below each other."""
    return pn.Row(*parts, sizing_mode="stretch_width", stylesheets=[_BESIDE])


def card(*parts: Any) -> Any:
    """A box with a border around what belongs together."""
    return pn.Column(*parts, sizing_mode="stretch_width", stylesheets=[_CARD])


def styled(widget: Any) -> Any:
    """A widget in the page's style."""
    widget.stylesheets = [*widget.stylesheets, panels.style()]
    return widget


def button(name: str, clicked: Callable[[Any], None], kind: str = "default") -> Any:
    """A button, whose click changes the page in one message."""
    made = styled(pn.widgets.Button(label=name, color=kind))
    made.on_click(partial(_clicked, clicked))
    return made


def _clicked(clicked: Callable[[Any], None], event: Any) -> None:
    at_once(partial(clicked, event))


def at_once(change: Callable[[], None]) -> None:
    """Send all that changes in one message, so that a tab never shows half of a step."""
    panels.share_styles()
    document = pn.state.curdoc
    # Bokeh goes through all models of the page at each change of what stands where, else once.
    frozen = nullcontext() if document is None else document.models.freeze()
    with pn.io.hold(), frozen:
        change()


def in_passing(change: Callable[[], None]) -> None:
    """Send a change of texts; to go through all models would take longer than the change."""
    with pn.io.hold():
        change()
