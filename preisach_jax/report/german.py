"""The tables and the method of a German report; a text that is not here stays in English."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from preisach_jax.diagnosis import evidence
from preisach_jax.identify import BLOCKS, FOLDS

if TYPE_CHECKING:
    from preisach_jax.diagnosis.result import Diagnosis

_LABELS = {
    # the error budget
    "noise": "Rauschen",
    "unpredictable between samples": "von Abtastwert zu Abtastwert nicht vorhersagbar",
    "of it, steps of the input": "davon Stufen des Eingangs",
    "at most; none if the drive itself moves in these steps":
        "höchstens; keine, wenn sich der Antrieb selbst in diesen Stufen bewegt",
    "of it, steps of the output": "davon Stufen des Ausgangs",
    "a step over √12": "eine Stufe durch √12",
    "discretisation": "Diskretisierung",
    "finite cells of the plane: another plane, and what comes back in its cells":
        "endliche Zellen der Ebene: eine andere Ebene, und was in ihren Zellen wiederkehrt",
    "memory": "Gedächtnis",
    "rarely visited cells, which only the held-out rows cover":
        "selten besuchte Zellen, die nur in zurückgehaltenen Zeilen vorkommen",
    "jumps": "Sprünge",
    "levels beside jumps of the sensor": "Pegel neben Sprüngen des Sensors",
    "unexplained": "nicht erklärt",
    "not explained by any of these": "durch nichts davon erklärt",
    "together": "zusammen",
    "held-out error of the final model (the squares add up)":
        "Fehler des endgültigen Modells auf zurückgehaltenen Zeilen (die Quadrate addieren sich)",
    # what the tests of an effect measured
    "decrease of the held-out mean square (share)":
        "Abnahme des mittleren Quadrats auf zurückgehaltenen Zeilen (Anteil)",
    "gain over the held-out blocks, in standard errors":
        "Gewinn über die zurückgehaltenen Blöcke, in Standardfehlern",
    "held-out blocks": "zurückgehaltene Blöcke",
    "ΔBIC on whitened residuals": "ΔBIC der geweißten Residuen",
    # record, model and software
    "data": "Daten",
    "SHA-256 of its values": "SHA-256 der Werte",
    "columns": "Spalten",
    "rows": "Zeilen",
    "duration": "Dauer",
    "stroke": "Hub",
    "state at the first sample": "Zustand beim ersten Abtastwert",
    "plane": "Ebene",
    "cells visited": "besuchte Zellen",
    "effects": "Effekte",
    "identified on": "identifiziert an",
    "software": "Software",
    "machine": "Rechner",
    "seeds": "Startwerte",
    "all 0: the same data and versions give the same results":
        "alle 0: Gleiche Daten und Versionen geben gleiche Ergebnisse",
}  # fmt: skip


def in_language(text: str, language: str) -> str:
    """A label of a table in a language.

    Example:
        >>> in_language("noise", "de"), in_language("noise", "en")
        ('Rauschen', 'noise')
    """
    return _LABELS.get(text, text) if language == "de" else text


def rows_in_language(rows: Iterable[tuple[str, ...]], language: str) -> list[tuple[str, ...]]:
    """The cells of a table in a language."""
    return [tuple(in_language(cell, language) for cell in row) for row in rows]


def method_in_german(found: Diagnosis) -> list[str]:
    """How a diagnosis was made, in paragraphs."""
    plane, record = found.model.plane, found.base.record
    even = plane.own_thresholds is None
    placed = "" if even else ", deren Schwellen liegen, wo sich der Ausgang bewegt"
    held_out = (
        f"Die gemessenen Zeilen sind in {BLOCKS} zusammenhängende Blöcke geteilt; jeder {FOLDS}. "
        "Block ist zurückgehalten, das Gedächtnis läuft durch ihn hindurch. Fehler auf "
        "zurückgehaltenen Zeilen sind die eines Modells, das ohne diese Blöcke identifiziert "
        "wurde. Das gespeicherte Modell ist an allen Zeilen identifiziert."
    )
    if apart := [run.name for run in record.runs if run.held_out]:
        held_out = (
            f"Alle Zeilen von {', '.join(apart)} sind zurückgehalten: Ihre Fehler sind die einer "
            "Vorhersage aus dem Eingang allein, mit dem gespeicherten Modell."
        )
    if record.runs:
        held_out += (
            " Die Messungen haben die Dichte und die Parameter der Effekte gemeinsam; jede hat "
            "ihr eigenes Gedächtnis, ihren eigenen Nullpunkt, ihre eigene Drift und ihr eigenes "
            "Brummen."
        )
    return [
        "Der Ausgang ist eine gewichtete Summe von Hysteronen auf der Preisach-Ebene [1, 2] in der "
        f"zeitdiskreten Form von [3], mit {plane.levels} Stufen je Achse "
        f"({plane.cells} Zellen){placed}; "
        "statt zu springen, schalten die Hysteronen über die Breite einer Zelle. Die Gewichte sind "
        "nicht negativ und glatt; wie glatt, entscheidet die Kreuzvalidierung. Zu gegebenen "
        "Parametern der Effekte folgen sie aus linearen kleinsten Quadraten; die Parameter selbst "
        "findet das Gauß-Newton-Verfahren (variable Projektion [4]).",
        held_out,
        "Ein Effekt wird nur genannt, wenn er zwei Tests besteht. Erstens fällt das mittlere "
        f"Quadrat auf zurückgehaltenen Zeilen um mindestens {100 * evidence.LEAST_GAIN:.0f} % und "
        f"um mehr als {evidence.LEAST_Z:g} Standardfehler über die Blöcke. Zweitens fällt das "
        "bayessche Informationskriterium [5] der Residuen, durch eine Autoregression geweißt, um "
        f"mehr als {evidence.LEAST_DELTA_BIC:g}. Effekte, die so gut bestehen wie der beste, "
        "bilden seine Familie: Diese Messung kann sie nicht unterscheiden.",
        "Intervalle gelten zu 95 %; sie folgen aus der gemeinsamen Linearisierung in Gewichten und "
        "Parametern, mit Residuen, die innerhalb eines Blocks korreliert sein dürfen. Die Bänder "
        "der Tests der Residuen gelten zu 99 % [6].",
    ]
