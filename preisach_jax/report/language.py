"""The words of the report in English and German, in one table."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from preisach_jax.diagnosis.wording import plain
from preisach_jax.errors import InputError
from preisach_jax.present.diagnosis import headline
from preisach_jax.quantity import number, quantity

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis, Finding

LANGUAGES = ("en", "de")

_WORDS: dict[str, tuple[str, str]] = {
    "diagnosis_of": ("Preisach diagnosis of", "Preisach-Diagnose von"),
    "loss": ("Loss per cycle", "Verlust je Umlauf"),
    "loss_caption": (
        "Energy that each closed cycle of the input loses, without cycles inside it; cycles of "
        "like ends and duration are averaged. The band holds the measured loss of 95 of 100 cycles "
        "if the model holds.",
        "Energie, die jeder geschlossene Umlauf des Eingangs verliert, ohne Umläufe darin; Umläufe "
        "mit gleichen Enden und gleicher Dauer sind gemittelt. Das Band enthält den gemessenen "
        "Verlust von 95 aus 100 Umläufen, wenn das Modell gilt.",
    ),
    "of_the_stroke": ("of the stroke", "des Hubs"),
    "error_left": ("RMS error on held-out rows", "RMS-Fehler auf zurückgehaltenen Zeilen"),
    "was": ("before", "vorher"),
    "next": ("What to do next", "Der nächste Schritt"),
    "record_this": ("Record this, then diagnose again:", "Dies messen und neu diagnostizieren:"),
    "excitation": (
        "The excitation, computed for this record:",
        "Die Anregung dafür, für diese Messung berechnet:",
    ),
    "use_model": (
        "Nothing more needs to be recorded. Predict with the model:",
        "Es braucht keine weitere Messung. Vorhersage mit dem Modell:",
    ),
    "worst": (
        "The part with the largest error: measured output, and the residual of each model",
        "Der Abschnitt mit dem größten Fehler: gemessener Ausgang und Residuum jedes Modells",
    ),
    "measured": ("measured", "gemessen"),
    "held_out": ("held out from the identification", "von der Identifikation zurückgehalten"),
    "residual": ("residual", "Residuum"),
    "time": ("time", "Zeit"),
    "without": ("without effects", "ohne Effekte"),
    "with": ("with", "mit"),
    "to_know": ("Read this first", "Vorab zu wissen"),
    "errors": ("The errors", "Die Fehler"),
    "model": ("model", "Modell"),
    "rms": ("held-out RMS", "RMS, zurückgehalten"),
    "percent": ("% of stroke", "% des Hubs"),
    "largest": ("largest", "größter"),
    "fit": ("fit %", "Fit %"),
    "whole_course": ("Measured output and model before and after",
                     "Gemessener Ausgang und Modell, vorher und nachher"),
    "waterfall": ("Held-out error as effects are added",
                  "Fehler auf zurückgehaltenen Zeilen, Effekt um Effekt"),
    "where_fails": ("Where the model fails", "Wo das Modell versagt"),
    "remains": ("What remains:", "Was bleibt:"),
    "goes_with": (
        "The residual, sorted by each quantity and averaged over parts of it. Means outside the "
        "grey band are unlikely to be chance.",
        "Das Residuum, nach jeder Größe sortiert und abschnittsweise gemittelt. Mittelwerte "
        "außerhalb des grauen Bandes sind kaum Zufall.",
    ),
    "nothing_remains": (
        "What remains of the error is within noise and discretisation.",
        "Was vom Fehler bleibt, liegt innerhalb von Rauschen und Diskretisierung.",
    ),
    "loops": ("Measured and modelled loops", "Gemessene und modellierte Schleifen"),
    "residual_caption": (
        "A residual that depends on none of these quantities is a band of constant width around "
        "zero in every panel.",
        "Ein Residuum, das von keiner dieser Größen abhängt, ist in jedem Feld ein Band gleicher "
        "Breite um null.",
    ),
    "tests_caption": (
        "White residuals that are uncorrelated with the input stay inside the shaded bands, each "
        "in its model's colour.",
        "Weiße Residuen, die mit dem Eingang nicht korrelieren, bleiben in den getönten Bändern, "
        "jedes in der Farbe seines Modells.",
    ),
    "missing": ("What is missing", "Was fehlt"),
    "none_added": ("No effect was added.", "Es wurde kein Effekt hinzugefügt."),
    "falls": ("The held-out error falls from {} to {} RMS with it.",
              "Mit ihm fällt der Fehler auf zurückgehaltenen Zeilen von {} auf {} RMS."),
    "cannot_tell": ("This record cannot tell it from {}.",
                    "Diese Messung kann ihn nicht unterscheiden von {}."),
    "parameter": ("parameter", "Parameter"),
    "value": ("value and 95 % interval", "Wert und 95-%-Intervall"),
    "meaning": ("meaning", "Bedeutung"),
    "seen_as": ("Seen in the residual as", "Im Residuum sichtbar als"),
    "evidence": ("Evidence", "Belege"),
    "source": ("Source", "Quelle"),
    "tried": ("Effects that were tried", "Versuchte Effekte"),
    "tried_alt": ("Effects that were tried, their gain, and why they were added or not",
                  "Versuchte Effekte, ihr Gewinn, und warum sie aufgenommen wurden oder nicht"),
    "not_there": ("What was not found", "Was nicht gefunden wurde"),
    "driven": (
        "Driven by the inverse of this model (preisach compensate), the stage would follow a "
        "course like this one with an error of about {own} RMS, the held-out error of the model; "
        "with the best straight line instead of the model, the error would be {straight}.",
        "Mit der Inversen dieses Modells (preisach compensate) folgt der Antrieb einem Verlauf wie "
        "diesem auf etwa {own} RMS genau; das ist der Fehler des Modells auf zurückgehaltenen "
        "Zeilen. Mit der besten Geraden statt des Modells wären es {straight}.",
    ),
    "limits": ("Upper limits (95 %) for the effects that were not found.",
               "Obere Grenzen (95 %) der Effekte, die nicht gefunden wurden."),
    "record_next": ("What to record next", "Was als Nächstes zu messen ist"),
    "why": ("Why", "Warum"),
    "answered": ("Nothing: the question is answered by this record.",
                 "Nichts: Diese Messung beantwortet die Frage."),
    "families": ("Effects that this record cannot tell apart:",
                 "Effekte, die diese Messung nicht unterscheiden kann:"),
    "budget": ("Error budget", "Fehlerbilanz"),
    "density": ("Density", "Dichte"),
    "density_caption": (
        "Weight of each cell divided by its area. There are no data for cells that were never "
        "visited; their weights follow from those of their neighbours. The colour scale is a "
        "square root; the diagonal, the reversible part, may exceed it.",
        "Gewicht jeder Zelle, geteilt durch ihre Fläche. Zu nie besuchten Zellen gibt es keine "
        "Daten; ihr Gewicht folgt aus dem der Nachbarn. Die Farbskala ist eine Quadratwurzel; die "
        "Diagonale, der reversible Anteil, kann über ihr Ende hinausgehen.",
    ),
    "form": ("A form of what remains", "Eine Form dessen, was bleibt"),
    "form_is_no_cause": (
        "This is a form, not a cause: it says how the remainder depends on the states at hand, "
        "and where to look. It is not part of the model, and other terms may do nearly as well.",
        "Das ist eine Form, keine Ursache: Sie sagt, wie der Rest von den bekannten Größen "
        "abhängt und wo zu suchen ist. Sie gehört nicht zum Modell, und andere Terme können fast "
        "ebenso gut sein.",
    ),
    "term": ("term", "Term"),
    "coefficient": ("coefficient", "Koeffizient"),
    "where_to_look": ("where to look", "wo zu suchen ist"),
    "form_caption": (
        "The remainder over the leading term, averaged over parts of equal numbers of rows, and "
        "what the form takes away of it.",
        "Der Rest über dem führenden Term, gemittelt über Teile gleich vieler Zeilen, und was die "
        "Form davon wegnimmt.",
    ),
    "learned_caption": (
        "Mean of the learned term over each of the states it depends on most (full), and where "
        "another state is low and where it is high (broken). What goes with the input alone or "
        "the output alone is left out: the density takes most of it up.",
        "Mittel des gelernten Terms über jeder der Größen, von denen er am meisten abhängt "
        "(durchgezogen), und dort, wo eine andere Größe klein und wo sie groß ist (gestrichelt). "
        "Was nur mit dem Eingang oder nur mit dem Ausgang geht, ist weggelassen: das meiste davon "
        "nimmt die Dichte auf.",
    ),
    "method": ("Method", "Verfahren"),
    "reproduce": ("To reproduce", "Zum Nachrechnen"),
    "beside": (
        "Beside this page: the figures as PNG, diagnosis.json, base.json (the model without "
        "effects) and model.json (the final one).",
        "Neben dieser Seite: die Bilder als PNG, diagnosis.json, base.json (das Modell ohne "
        "Effekte) und model.json (das endgültige).",
    ),
    "printed": (
        "This printout is a summary. report.html also has the tests of the residual, all effects "
        "that were tried, upper limits, the density and the method.",
        "Dieser Ausdruck ist eine Zusammenfassung; report.html hat außerdem die Tests des "
        "Residuums, alle versuchten Effekte, obere Grenzen, die Dichte und das Verfahren.",
    ),
    "figure": ("Figure, enlarged", "Bild, vergrößert"),
    "close": ("Close", "Schließen"),
}  # fmt: skip

_HEADLINES_DE = {
    "adequate": "Es fehlt nichts",
    "explained": "Der fehlende Effekt wurde gefunden",
    "partly_explained": "Ein Effekt wurde gefunden, aber ein Teil des Fehlers bleibt",
    "unexplained": "Etwas fehlt, aber keiner der versuchten Effekte erklärt es",
}

_EFFECTS_DE = {
    "creep": "Kriechen (der Ausgang läuft weiter, wenn der Eingang steht)",
    "operator_creep": "Kriechen mit Schwelle",
    "reptation": "Reptation (das Gedächtnis verblasst mit dem Weg des Eingangs)",
    "drift": "eine Drift der Messung, die nicht vom Eingang abhängt",
    "delay": "eine reine Totzeit zwischen Eingang und gemessenem Ausgang",
    "input_lag": "eine Verzögerung des Antriebs (erster Ordnung)",
    "output_lag": "eine Verzögerung des Sensors (erster Ordnung)",
    "slew_limit": "eine Grenze der Geschwindigkeit des Antriebs",
    "rate_dependence": "Ratenabhängigkeit (je schneller der Eingang, desto breiter die Schleife)",
    "resonance": "eine Resonanz der Mechanik",
    "hum": "ein Netzbrummen oder eine andere feste Linie im Messsignal",
    "ageing": "Alterung (die Schleife schrumpft mit der Zeit)",
    "moving": "Rückwirkung des Ausgangs auf das Material (bewegtes Modell)",
    "eddy_currents": "Wirbelströme (die Geschwindigkeit des Ausgangs wirkt zurück)",
    "output_nonlinearity": "ein nichtlinearer Sensor (er verformt die ganze Schleife gleich)",
    "input_quantisation": "grobe Stufen des Wandlers im Antrieb",
    "excess_loss": "Zusatzverluste (ein Feld mit der Wurzel der Rate des Eingangs)",
    "viscosity": "Dämpfung (eine Kraft, die von der Geschwindigkeit des Eingangs abhängt)",
    "leakage": "Leckage der Messung (sie vergisst langsame Signale)",
    "log_rate": "Ratenabhängigkeit mit dem Logarithmus der Geschwindigkeit",
    "restoring_force": "eine Mechanik um die Hysterese herum (Masse, Dämpfung, Feder)",
    "output_quantisation": "grobe Stufen des Wandlers im Sensor",
}

_OF_COLUMN_DE = {
    "aux": "der Einfluss von {}",
    "gain": "eine Schleife, deren Größe von {} abhängt",
    "cross": "Übersprechen von {} durch die Mechanik",
}


def check_language(language: str) -> str:
    """The language, if it is one of `LANGUAGES`.

    Raises:
        InputError: it is another.

    Example:
        >>> check_language("de")
        'de'
    """
    if language not in LANGUAGES:
        raise InputError(f"the language is {language!r}; give {' or '.join(LANGUAGES)}")
    return language


def words(language: str) -> Mapping[str, str]:
    """The words of the templates in a language, by key."""
    place = LANGUAGES.index(check_language(language))
    return MappingProxyType({key: texts[place] for key, texts in _WORDS.items()})


def effect_name(effect: str, language: str) -> str:
    """An effect in the words of a language."""
    if language == "en":
        return plain(effect)
    prefix, _, column = effect.partition(":")
    if column and prefix in _OF_COLUMN_DE:
        return _OF_COLUMN_DE[prefix].format(column)
    return _EFFECTS_DE.get(effect, plain(effect))


def verdict_headline(found: Diagnosis, language: str) -> str:
    """The verdict in a few words of a language."""
    if language == "en":
        return headline(found)
    if found.verdict == "adequate" and found.next_experiment is not None:
        return "Kein fehlender Effekt ist zu erkennen, aber diese Messung könnte kaum einen zeigen"
    if not found.effects and found.without_hysteresis is not None:
        return "Es ist keine Hysterese zu sehen"
    if found.verdict == "adequate" and found.budget.is_of_the_plane(found.base.record.output_range):
        return "Kein Effekt ist zu sehen: Die Zellen der Ebene sind die Grenze"
    several = len(found.effects) > 1 and found.verdict == "explained"
    return "Die fehlenden Effekte wurden gefunden" if several else _HEADLINES_DE[found.verdict]


def verdict_sentence(found: Diagnosis, language: str) -> str:
    """The verdict in one sentence of a language, and whether it is close."""
    if language == "en":
        return found.sentence
    close = " Das Urteil ist knapp." if found.close else ""
    return _hysteresis_in_german(found) + _german_sentence(found) + close


def _hysteresis_in_german(found: Diagnosis) -> str:
    if (enough := found.without_hysteresis) is not None:
        name = _MEMORYLESS_DE[enough.name]
        return f"Keine Hysterese: {name} sagt den Ausgang ebenso gut voraus. "
    nearly = [_MEMORYLESS_DE[model.name] for model in found.memoryless if model.does_nearly]
    return f"Es gibt wenig Hysterese: {nearly[0]} lässt kaum einen Fehler. " if nearly else ""


_MEMORYLESS_DE = {"straight line": "eine Gerade", "single-valued curve": "eine eindeutige Kurve"}


def _german_sentence(found: Diagnosis) -> str:
    budget, stroke = found.budget, found.base.record.output_range
    first, last = (
        f"{quantity(rung.rms_validation, budget.unit, 3)} RMS "
        f"({number(100 * rung.rms_validation / stroke, 2)} % des Hubs)"
        for rung in (found.ladder[0], found.ladder[-1])
    )
    left = quantity(budget.unexplained, budget.unit, 3)
    rest = "Rauschen und das Gitter des Modells"
    if not budget.is_met:
        rest += f", und {left} innerhalb der Toleranz"
    if found.verdict != "unexplained" and budget.is_of_the_plane(stroke):
        rest = (
            "vor allem, was die Zellen der Ebene nicht wiedergeben "
            f"({quantity(budget.discretisation, budget.unit, 3)}; Rauschen: "
            f"{quantity(budget.noise, budget.unit, 3)})"
        )
    if found.verdict == "adequate" and budget.is_of_the_plane(stroke):
        return f"Kein Effekt ist zu sehen: Das reine Hysteresemodell lässt {last}, {rest}."
    if found.verdict == "adequate":
        return (
            "Es fehlt nichts: Das reine Hysteresemodell sagt den Ausgang auf "
            f"{last} voraus; das ist {rest}."
        )
    if found.verdict == "unexplained":
        return (
            "Etwas fehlt, aber keiner der versuchten Effekte erklärt es: Vom Fehler von "
            f"{last} sind {left} weder Rauschen noch Gitter."
        )
    named = " und ".join(_with_family(finding) for finding in found.findings)
    tail = (
        f"was bleibt, ist {rest}" if found.verdict == "explained"
        else f"{left} davon sind noch nicht erklärt"
    )  # fmt: skip
    return (
        f"Dem reinen Hysteresemodell fehlt {named}: Damit fällt der Fehler von {first} auf "
        f"{last}; {tail}."
    )


def _with_family(finding: Finding) -> str:
    name = effect_name(finding.effect, "de")
    if len(finding.family) == 1:
        return name
    others = " oder ".join(finding.family[1:])
    return f"{name} (oder {others}, was diese Messung nicht unterscheidet)"
