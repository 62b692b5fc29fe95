"""The pages of the effects, written from what the library says of itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np
from telling import COLUMNS, TELLING

import preisach_jax as pj
from preisach_jax.effects.base import Effect, Survey
from preisach_jax.effects.parameter import Parameter
from preisach_jax.quantity import number, pretty_unit
from preisach_jax.signals import diagnostic_record

EXAMPLE = "24 s at 500 Hz, 0 to 75 V, 60 µm"


def file_name(name: str) -> str:
    """Name of an effect's page and picture, without ending.

    Example:
        >>> file_name("aux:COL")
        'aux'
    """
    return name.partition(":")[0]


@cache
def example_survey() -> Survey:
    """An ordinary record, to which effects are bound so that their bounds can be told."""
    drive = diagnostic_record(24.0, 500.0)
    time = np.arange(len(drive)) / 500.0
    residual = np.zeros_like(drive)
    return Survey(24.0, 1 / 500.0, time, drive, 0.8 * drive, residual)


def page(effect: Effect, others: Mapping[str, Effect]) -> str:
    """The page of one effect in Markdown."""
    shown = TELLING[effect.name]
    picture = f"../assets/effects/{file_name(effect.name)}.png"
    added = COLUMNS.get(effect.name, effect.name)
    only = (
        f"\n!!! note\n    A diagnosis tries it only where it is asked for: "
        f"`--effects {effect.name},...` or `effects=[{effect.name!r}, ...]`.\n"
        if effect.on_request
        else ""
    )
    confused = ", ".join(_link(name, others) for name in effect.confused_with) or "nothing known"
    return f"""# {effect.name}

Acts on {effect.place.acts_on}.
{only}
## Physics

{effect.physics}

*Source:* {effect.source}.

## What its residual looks like

{_sentence(effect.signature)}

<figure markdown="span">
![Residual of a stage with {effect.name} hidden in it]({picture})
<figcaption markdown="span">{shown.look} Orange: what the rate-independent model leaves; blue:
what remains with `{added}` added. {shown.source(effect.name)}</figcaption>
</figure>

## What it is confused with

{confused}.

**Told apart by:** {effect.experiment}.

## Parameters

{_parameter_table(effect.bound_to(example_survey()))}

Bounds are those on a record of {EXAMPLE}; the search sets them for each record. *Free* stands for
a coefficient that enters the model linearly and has no bounds.

## In use

```sh
{_command(effect.name)}
```

Code and docstring: [reference](../reference/effects.md).
"""


def index(effects: Mapping[str, Effect]) -> str:
    """The overview of all effects in Markdown."""
    rows = [
        f"| {_link(effect.name, effects)}{' *' * effect.on_request} | {effect.place.acts_on} "
        f"| {effect.signature} "
        f"| {', '.join(_link(name, effects) for name in effect.confused_with)} |"
        for effect in effects.values()
    ]
    return "\n".join(
        [
            "# Effects",
            "",
            "What the library knows, from the command to the reading. Each page has the physics, "
            "its source, the parameters, a picture of what the effect leaves in the residual of a "
            "rate-independent model, and the experiment that tells it from what looks alike. The "
            "pictures are made by `docs/pictures.py`.",
            "",
            "```",
            "u ─► input ─► hysteresis ─► weights ─► output ─► (+) ─► sensor ─► z",
            "     effects    effects      effects    effects    │     effects",
            "                                     added effects ┘",
            "```",
            "",
            "| effect | acts on | seen in the residual as | confused with |",
            "|---|---|---|---|",
            *rows,
            "",
            "\\* tried on request only: `moving` and `eddy_currents` take minutes on a fine plane, "
            "`moving` compensates discretisation of a coarse one, and `operator_creep` follows "
            "much "
            "that is slow, whatever it is.",
            "",
            "`preisach effects` prints the same table, `preisach effects NAME` one entry. "
            "[Write one of your own](../how-to/own-effect.md).",
            "",
        ]
    )


def pages() -> dict[str, str]:
    """All pages of effects by their place in the documentation."""
    library = pj.effects()
    own = {name: effect for name, effect in library.items() if name in TELLING}
    return {"effects/index.md": index(own)} | {
        f"effects/{file_name(name)}.md": page(effect, own) for name, effect in own.items()
    }


def reference() -> str:
    """The classes of all effects, for the reference of the code."""
    kinds = [type(effect) for effect in pj.effects().values()]
    options = "    options: { heading_level: 3, members: false }\n"
    return "".join(f"\n::: {kind.__module__}.{kind.__name__}\n{options}" for kind in kinds)


def _link(name: str, others: Mapping[str, Effect]) -> str:
    return f"[{name}]({file_name(name)}.md)" if name in others else f"`{name}`"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _command(name: str) -> str:
    if name in COLUMNS:
        column = COLUMNS[name].partition(":")[2]
        return (
            f"preisach diagnose stage.csv --aux {column}\n"
            f"preisach fit stage.csv --aux {column} --effects {COLUMNS[name]} --out model.json"
        )
    return f"preisach fit stage.csv --effects {name} --out model.json"


def _parameter_table(effect: Effect) -> str:
    own = [(parameter, False) for parameter in effect.parameters()]
    linear = getattr(effect, "coefficients", tuple)()
    rows = [_row(*each) for each in (*own, *((parameter, True) for parameter in linear))]
    return "\n".join(["| parameter | meaning | unit | bounds |", "|---|---|---|---|", *rows])


def _row(parameter: Parameter, linear: bool) -> str:
    unit = parameter.unit.format(u="V", z="µm", aux="N")
    shown = pretty_unit(unit) if unit != "1" else "–"
    free = linear or not (math.isfinite(parameter.low) and math.isfinite(parameter.high))
    bounds = "free" if free and not math.isfinite(parameter.high) else _span(parameter)
    meaning = parameter.meaning.replace("|", "\\|")
    return f"| `{parameter.name}` | {meaning} | {shown} | {bounds} |"


def _span(parameter: Parameter) -> str:
    low, high = (number(value, 3) for value in (parameter.low, parameter.high))
    return f"{low} to {high}{', searched by its logarithm' if parameter.log else ''}"
