"""Words in the names of columns, their kinds of signal and units, and the factors of units to those of recordings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import pi
from typing import NamedTuple
from unicodedata import combining, normalize

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Array

Units = Mapping[str, tuple[float, float]]  # numerator and denominator of the factor by unit
TIME: Units = {"s": (1, 1), "ms": (1, 1e3), "us": (1, 1e6), "ns": (1, 1e9), "min": (60, 1), "h": (3600, 1)}
ANGLE: Units = {"rad": (1, 1), "mrad": (1, 1e3), "deg": (pi, 180), "rev": (2 * pi, 1)}
LENGTH: Units = {"m": (1, 1), "cm": (1, 100), "mm": (1, 1e3), "um": (1, 1e6)}
FORCE: Units = {"N": (1, 1), "mN": (1, 1e3), "kN": (1e3, 1), "kgf": (9.80665, 1)}
TORQUE: Units = {
    "N.m": (1, 1),
    "mN.m": (1, 1e3),
    "N.cm": (1, 100),
    "N.mm": (1, 1e3),
    "kN.m": (1e3, 1),
    "kgf.m": (9.80665, 1),
    "kgf.cm": (9.80665, 100),
}
CURRENT: Units = {"A": (1, 1), "mA": (1, 1e3)}
DUTY: Units = {"1": (1, 1), "%": (1, 100)}
VOLTAGE: Units = {"V": (1, 1), "mV": (1, 1e3), "dV": (1, 10)}
TEMPERATURE: Units = {"C": (1, 1), "degC": (1, 1)}


class Word(NamedTuple):
    """Meaning of a word; "" where it says nothing."""

    kind: str = ""  # kind of column: q, dq, tau, t, ...
    unit: str = ""  # as in column maps
    side: str = ""  # what it says about the signal, or "joint" of any joint, "none" of a quantity that is no signal
    weak: bool = False  # whether its kind gives way to that of another word


WORDS = {  # for kinds of columns
    "q": "position",
    "dq": "velocity",
    "ddq": "acceleration",
    "tau": "torque",
    "current": "current",
    "q_des": "desired position",
    "dq_des": "desired velocity",
    "volt": "voltage",
    "temp": "temperature",
}
_TABLE: Mapping[Word, str] = {
    Word("q"): "q pos position positions ang angle angles theta qpos jpos winkel posicion posizione angulo angolo",
    Word("q", weak=True): "enc encoder ticks tick count counts",
    Word("dq"): "dq qd qdot vel velo velocity velocities speed speeds omega qvel jvel geschwindigkeit drehzahl vitesse "
    "velocidad velocita",
    Word("ddq"): "ddq qdd qddot acc accel acceleration accelerations qacc beschleunigung aceleracion accelerazione",
    Word("tau"): "tau torque torques torq trq eff effort efforts moment moments drehmoment qfrc jtrq jtorq jtor "
    "couple coppia momento",
    Word("tau", weak=True): "load force last kraft",
    Word("current"): "current currents cur curr amps strom courant corriente corrente",
    Word("current", side="measured"): "iq",
    Word("tau", side="measured"): "par",
    Word("pwm"): "pwm duty dutycycle",
    Word("volt"): "volt volts voltage voltages spannung",
    Word("temp"): "temp temperature temperatures temperatur",
    Word("t"): "t tout time times timestamp timestamps stamp stamps clock elapsed epoch uptime runtime systime "
    "datetime zeit zeiten zeitstempel zeitmarke zeitpunkt uhrzeit laufzeit temps horodatage heure tiempo marca hora "
    "tempo instante istante orario marcatempo",
    Word(side="enabled"): "on enable enabled",
    Word(side="commanded"): "des desired cmd command commands commanded target targets ref reference goal set setpoint "
    "action soll demand demanded consigne consigna comando",
    Word(side="measured"): "act actual measured meas present feedback fb fbk ist mesure value val raw state states "
    "observation est estimate estimated",
    Word(side="absolute"): "abs absolute magnitude unsigned betrag",
    Word(side="forward"): "ff feedforward feedfwd",
    Word(side="rate"): "dot rate",
    Word(side="second rate"): "ddot",
    Word(side="joint"): "joint joints motor motors axis axes achse achsen axe eje ejes asse gelenk giunto giunti "
    "articulation articulacion servo servos drive drives actuator actuators dof",
    Word(side="none"): "ext external error err deviation limit limits lim max min maximum minimum kp kd ki gain gains "
    "stiffness damping gravity friction tcp pose cartesian mode status residual noise power energy",
    Word(unit="deg/s"): "deg/s deg_s degs deg/sec dps grad/s °/s",
    Word(unit="rad/s"): "rad/s rad_s rads rad/sec",
    Word(unit="rpm"): "rpm u/min rev/min",
    Word(unit="deg"): "deg degree degrees ° grad grados gradi degres",
    Word(unit="mrad"): "mrad",
    Word(unit="rad"): "rad radian radians",
    Word(unit="mm"): "mm",
    Word(unit="ms"): "ms msec msecs millis milliseconds millisekunden millisecondes milisegundos millisecondi",
    Word(unit="us"): "us usec usecs micros microseconds mikrosekunden microsecondes microsegundos microsecondi",
    Word(unit="ns"): "ns nsec nsecs nanosec nanosecs nanos nanoseconds",
    Word(unit="s"): "s sec secs second seconds sekunde sekunden seconde secondes segundo segundos secondi",
    Word(unit="mN.m"): "mnm mn.m",
    Word(unit="N.cm"): "ncm n.cm",
    Word(unit="N.m"): "nm n.m n*m",
    Word(unit="mA"): "ma",
}
_BRACKETED: Mapping[str, str] = {  # spellings that need brackets, a row of units or the kind
    "A": "a amp",
    "m": "m",
    "N": "n newton",
    "V": "v",
    "mV": "mv",
    "C": "c degc °c",
    "h": "h",
    "min": "min",
    "m/s": "m/s",
    "mm/s": "mm/s",
    "cm": "cm",
    "um": "um µm",
    "us": "µs",
    "mrad/s": "mrad/s",
    "rev": "rev",
    "rad/s2": "rad/s2 rad/s^2 rad/s² rad/s/s",
    "deg/s2": "deg/s2 deg/s^2 deg/s² °/s² °/s^2",
    "m/s2": "m/s2 m/s^2 m/s²",
    "N.m": "n·m n-m",
    "N.mm": "nmm n.mm",
    "kN.m": "knm kn.m",
    "kN": "kn",
}
CLOCKS = frozenset(  # words beside one of time, which say whose it is or since when
    "log ros sim unix posix system sys host local header recv receive received record recorded sample wall cpu robot "
    "controller monotonic utc gmt since from start boot begin rel relative run total in de del du di da le la el "
    "der des seit dauer temporal temporale transcurrido trascorso ecoule depuis desde".split()
)
VOCABULARY: Mapping[str, Word] = {spelt: word for word, words in _TABLE.items() for spelt in words.split()}
UNITS = {spelt: word.unit for spelt, word in VOCABULARY.items() if word.unit}  # spelt without brackets
SPELLINGS = {**UNITS, **{spelt: unit for unit, words in _BRACKETED.items() for spelt in words.split()}}
_ENDING = re.compile(
    r"[\s_./([-]+(" + "|".join(map(re.escape, sorted(UNITS, key=len, reverse=True))) + r")[\])]*$", re.IGNORECASE
)
_WITHIN = re.compile(r"(?<![a-z])(deg[_/]s|rad[_/]s|deg|rpm|ms|us|ns|mm|mnm)(?![a-z])", re.IGNORECASE)
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()\s](?:[^\[\]()]{0,20}[^\[\]()\s])?)\s*[\])]\s*$")
_IN = re.compile(r"(?<=\w)[\s_]+in[\s_]+(\S{1,10})$", re.IGNORECASE)  # "Strom in A"
_NO_UNIT = ("", "-", "[]", "[-]", "()", "(-)")  # cells of a row of units for columns without one
INTEGRAL = "integral of "  # beginning of the names of positions that are integrated from velocities
_MIN_PART_LETTERS = 3  # letters of each part of a compound
_RATES = re.compile(r"(d{1,2})(theta|pos|position|angle)")


def words_of(text: str) -> list[str]:
    """Words of a name in lower case, compounds in their parts: "jointPos_1" and "jointpos1" have joint, pos and 1."""
    plain = "".join(letter for letter in normalize("NFD", text) if not combining(letter))  # posición is posicion
    words = [word.lower() for word in re.findall(r"[A-Z]?[^\W\d_A-Z]+|[A-Z]+(?![a-z])|\d+", plain)]
    for k in range(len(words) - 1, 0, -1):
        if words[k - 1] + words[k] in VOCABULARY and min(len(words[k - 1]), len(words[k])) >= _MIN_PART_LETTERS:
            words[k - 1 : k + 1] = [words[k - 1] + words[k]]  # "set point"
    return [part for word in words for part in _parts(word)]


def kinds_of(name: str) -> set[str]:
    """Kinds that the words of a name mean."""
    return {VOCABULARY[word].kind for word in words_of(name) if word in VOCABULARY}


def bracketed(name: str) -> tuple[str, str]:
    """A name without the unit at its end, in brackets or behind "in", and this unit; "" without a known one."""
    inside = _BRACKETS.search(name[-60:]) or _IN.search(name[-60:])
    unit = _spelt(inside[1]) if inside else ""
    return (name[: inside.start() + max(0, len(name) - 60)], unit) if inside and unit else (name, "")


def without_unit(name: str) -> tuple[str, str]:
    """A name without its unit, in brackets or not, and the unit, "" if there is none."""
    plain, unit = bracketed(name)
    if unit:
        return plain, unit
    if ended := _ENDING.search(name):
        return name[: ended.start()], UNITS[ended[1].lower()]
    if within := _WITHIN.search(name):
        return f"{name[: within.start()]} {name[within.end() :]}", UNITS[within[1].lower()]
    return name, ""


def unit_row(cells: list[str]) -> list[str] | None:
    """Units of the cells of a row, "" for cells without one; None if it is no row of units."""
    cell_units = ["" if cell.strip() in _NO_UNIT else _spelt(cell.strip().strip("[]()")) or None for cell in cells]
    units = [unit for unit in cell_units if unit is not None]
    return units if len(units) == len(cell_units) and any(units) else None


def _spelt(text: str) -> str:
    return SPELLINGS.get(text.strip().lower(), "")


def _parts(word: str) -> list[str]:
    """A word, or the parts of a compound of known words, such as jointpos, istposition and dtheta."""
    if word in VOCABULARY:
        return [word]
    if rate := _RATES.fullmatch(word):
        return [rate[2], {"d": "dot", "dd": "ddot"}[rate[1]]]
    for k in range(len(word) - _MIN_PART_LETTERS, _MIN_PART_LETTERS - 1, -1):
        begun, rest = word[:k], word[k:]
        if begun in (*VOCABULARY, "arm") and begun not in UNITS and rest in VOCABULARY and rest not in UNITS:
            return [begun, rest]
    return ["q", word[1:]] if word[:1] == "q" and VOCABULARY.get(word[1:], Word()).side == "commanded" else [word]


def _rates(units: Units, power: str) -> Units:
    return {f"{unit}/s{power}": factor for unit, factor in units.items()}


OF: Mapping[str, tuple[Units, Units]] = {  # at revolute and at prismatic joints
    "t": (TIME, TIME),
    "q": (ANGLE, LENGTH),
    "q_des": (ANGLE, LENGTH),
    "dq": ({**_rates(ANGLE, ""), "rpm": (pi, 30)}, _rates(LENGTH, "")),
    "ddq": (_rates(ANGLE, "2"), _rates(LENGTH, "2")),
    "tau": (TORQUE, FORCE),
    "abs_tau": (TORQUE, FORCE),
    "current": (CURRENT, CURRENT),
    "abs_current": (CURRENT, CURRENT),
    "dq_des": ({**_rates(ANGLE, ""), "rpm": (pi, 30)}, _rates(LENGTH, "")),
    "tau_ff": (TORQUE, FORCE),
    "on": ({"1": (1, 1)}, {"1": (1, 1)}),
    "pwm": (DUTY, DUTY),
    "volt": (VOLTAGE, VOLTAGE),
    "temp": (TEMPERATURE, TEMPERATURE),
}
TURN = 65536.0  # values of a register of 16 bits


class Change(NamedTuple):
    """Conversion of a unit: value * scale / over + offset."""

    scale: float = 1.0
    over: float = 1.0
    offset: float = 0.0

    def __str__(self) -> str:
        return f"value * {self.scale / self.over:.6g} + {self.offset:.6g}"

    def apply(self, values: Array, start: int = 0) -> Array:
        """Convert values (N,) [unit of the source]; `start` is not used."""
        return values * self.scale / self.over + self.offset


def signed_register(values: Array, start: int = 0) -> Array:
    """Duties whose signed numbers were read as unsigned ones of 16 bits, with their sign.

    values: (N,) [any unit] of a register; `start` is not used.
    """
    return np.where(values > TURN / 2 - 1, values - TURN, values)


def change_of(unit: str, kind: str, prismatic: bool | None, subject: str) -> Change:
    """Conversion from a unit ("N.m" and "Nm" are equivalent) of a kind of column (q, tau, ...) to that of recordings.

    `prismatic` is None if the type of the joint is unknown; `subject` begins the error message.

    Raises:
        RecordingError: unknown unit, or a unit that does not fit the kind of column or joint.
    """
    turning, sliding = OF[kind]
    known = {**sliding, **turning} if prismatic is None else sliding if prismatic else turning
    spelt = {name.replace(".", ""): name for name in known}
    name = unit if unit in known else spelt.get(unit.replace("*", "").replace(" ", ""), "")
    if not name:
        joint = "prismatic" if prismatic else "revolute"
        at = "" if prismatic is None or turning is sliding else f" at a {joint} joint"
        raise RecordingError(f"{subject} has the unit {unit!r}; expected{at} {shorten(list(known), 12)}")
    return Change(*known[name])
