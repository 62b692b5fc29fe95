"""What columns are called and measured in, as data: quantities, and which drives which.

A name tells a quantity by one of its words, in several languages and with a letter wrong, else its
unit does.  Of two quantities of a pair the first is what a rig usually commands.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from functools import lru_cache


@dataclass(frozen=True)
class Quantity:
    """What a column may hold: words of its name, beginnings of words, and units."""

    words: frozenset[str]
    units: frozenset[str]


def _quantity(words: str, units: str) -> Quantity:
    return Quantity(frozenset(words.split()), frozenset(units.split()))


QUANTITIES = {
    "field": _quantity(
        "field feld champ campo magneticfield happ happlied 磁场 磁界 磁場 поле",
        "T mT Oe kOe A/m kA/m Am-1",
    ),
    "moment": _quantity(
        "moment magnetization magnetisation magnetisierung aimantation magnetizzazione 磁化 磁矩 "
        "намагниченность",
        "emu memu uemu Am2 Am² A·m² A·m2 emu/g emu/cm3 emu/cc kA·m² Am2/kg Am²/kg A·m²/kg",
    ),
    "induction": _quantity("induction flux fluxdensity flussdichte 磁感应 индукция", "Wb mWb Vs"),
    "polarisation": _quantity(
        "polarization polarisation polarisierung 极化 分極 поляризация",
        "uC/cm2 µC/cm2 μC/cm2 uC/cm² µC/cm² μC/cm² uC/cm^2 µC/cm^2 C/m2 C/m² C/m^2 "
        "uC_per_cm2 mC/m2",
    ),
    "charge": _quantity("charge ladung q 电荷 заряд", "C mC uC µC nC pC"),
    "capacity": _quantity(
        "capacity kapazität capacité dod soc qdischarge qcharge 容量",
        "Ah A·h A.h mAh mA·h mA.h uAh mAh/g mA.h/g",
    ),
    "electric field": _quantity("efield", "V/m kV/m MV/m kV/cm V/cm kV/mm V/um V/µm"),
    "voltage": _quantity(
        "voltage volt volts spannung tension tensión tensione voltaje v+ vplus vdrive ewe ecell "
        "vcell potential bias 电压 電圧 напряжение",
        "V mV kV",
    ),
    "current": _quantity("current strom courant corriente corrente 电流 電流 ток", "A mA uA µA nA"),
    "strain": _quantity(
        "strain dehnung déformation deformation deformación deformazione elongation ε "
        "extensometer 应变 ひずみ деформация",
        "mm/mm m/m in/in ustrain µstrain microstrain µε strain",
    ),
    "stress": _quantity(
        "stress contrainte esfuerzo sforzo σ 应力 応力",
        "MPa GPa kPa Pa N/mm2 N/mm² N/mm^2 ksi",
    ),
    "angle": _quantity("angle winkel rotation drehwinkel θ theta 角度 угол", "deg rad mrad °"),
    "displacement": _quantity(
        "displacement disp position pos stroke weg auslenkung hub verschiebung déplacement "
        "deplacement desplazamiento spostamento crosshead traverse deflection extension "
        "verformung 位移 変位 перемещение",
        "m mm um µm μm nm pm cm in inch",
    ),
    "force": _quantity(
        "force load kraft last fuerza forza effort loadcell 力 荷重 载荷 "
        "荷载 сила усилие",
        "N mN kN MN lbf kip kips kgf lb",
    ),
    "torque": _quantity("torque drehmoment couple 扭矩 トルク", "Nm mNm kNm N·m"),
    "pressure": _quantity("pressure druck pression presión pressione 压力 圧力 давление",
                          "bar mbar psi Pa hPa kPa MPa"),
    "temperature": _quantity(
        "temperature temp temperatur température temperatura 温度 температура",
        "K degC °C C degF °F",
    ),
    "resistance": _quantity("resistance widerstand résistance 电阻 抵抗", "Ohm ohm Ω kΩ kOhm mΩ"),
    "capacitance": _quantity("capacitance", "F uF µF nF pF"),
}  # fmt: skip

# In this order: where two pairs are there, the first is taken and the other is told.
PAIRS = (
    ("field", "moment"), ("field", "induction"), ("electric field", "polarisation"),
    ("voltage", "polarisation"), ("electric field", "strain"), ("strain", "stress"),
    ("voltage", "displacement"), ("voltage", "strain"), ("capacity", "voltage"),
    ("pressure", "displacement"), ("pressure", "angle"), ("angle", "torque"),
    ("displacement", "force"), ("displacement", "stress"), ("strain", "force"),
    ("temperature", "strain"), ("temperature", "displacement"), ("strain", "resistance"),
    ("strain", "capacitance"), ("displacement", "resistance"), ("displacement", "capacitance"),
    ("force", "resistance"), ("force", "capacitance"), ("pressure", "resistance"),
    ("temperature", "resistance"), ("temperature", "moment"), ("temperature", "stress"),
    ("current", "displacement"), ("current", "force"), ("current", "induction"),
    ("current", "moment"), ("voltage", "charge"), ("voltage", "force"), ("voltage", "current"),
    ("pressure", "force"), ("force", "angle"), ("stress", "polarisation"),
)  # fmt: skip

# What stands beside a quantity and is no signal of its own.
QUALIFIED = re.compile(
    r"(?<![a-z])(min|max|minimum|maximum|mean|avg|std|stderr|err|error|dev|deviation|uncertainty"
    r"|adjusted|adj|corrected|filtered|smoothed|raw|peak|range|rate|limit)(?![a-z])"
)
COUNTERS = re.compile(
    r"(?<![a-z])(index|point|points|pt|no|nr|number|row|cycle|cycles|count|counts|counter|step|"
    r"segment|scan|status|sample|samples|record|id|ns)(?![a-z])|^n$|^#$|^unnamed"
)

_ALIKE = 0.86  # of two words of six letters or more, one of which is misspelt


def words_of(name: str) -> list[str]:
    """The words of a name in lower case, with a sign that belongs to one (`V+`)."""
    spread = re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z][a-z])", " ", name)
    return re.findall(r"[^\W\d_]+[+]?\d?", spread.lower())


@lru_cache(maxsize=1024)
def quantity_of(name: str, unit: str) -> str:
    """The quantity that a name, without its unit, and a unit tell; `""` if neither does."""
    words = words_of(name)
    plain = [word.rstrip("0123456789") for word in words]
    for kind, quantity in QUANTITIES.items():
        if quantity.words & {*words, *plain} and _fits(kind, unit):
            return kind
    for kind, quantity in QUANTITIES.items():
        if unit in quantity.units:
            return kind
    long = [word for word in plain if len(word) >= 6]
    for kind, quantity in QUANTITIES.items():
        own = [word for word in quantity.words if len(word) >= 6]
        if any(difflib.get_close_matches(word, own, 1, _ALIKE) for word in long):
            return kind if _fits(kind, unit) else ""
        if any(word in name for word in quantity.words if not word.isascii() and len(word) < 4):
            return kind
    return ""


def foreign_words_in(text: str) -> int:
    """How many words of quantities in scripts other than Latin and Greek stand in a text."""
    words = {word for quantity in QUANTITIES.values() for word in quantity.words}
    return sum(word in text for word in words if len(word) > 1 and word[0] >= "\u0400")


def _fits(kind: str, unit: str) -> bool:
    """Whether a unit does not speak against a quantity: it is no other quantity's."""
    others = [each for each, quantity in QUANTITIES.items() if unit in quantity.units]
    return not others or kind in others
