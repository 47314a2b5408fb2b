"""The recorded runs inside a ``.b5r`` file, and the unit of their readings.

A public reader of such files takes the numbers from ``READINGS`` elements, separated by spaces, each behind a sibling
``RUN_DIRECTION``. That is all that is known: unit, spacing and first angle of the readings are not published.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.b5r import Imported, parse_xml, read_b5r
from mjsim.importing.reading import Options
from mjsim.importing.units import LENGTH, unit_named
from mjsim.machine.chain import FIVE_AXIS
from mjsim.units import UM

#: Units that the data may decide for, in µm. They lie a factor of ten apart, so that one at most agrees.
CANDIDATES = {"µm": 1.0, "0.1 µm": 0.1, "mm": 1000.0}
#: The readings' circular deviation may be so many times the file's circularity, or a part of it: filters and centring
#: differ.
AGREES = 3.0
_HUGE = 1e9
_SPEC = (
    "INSTRUMENT",
    "DYNAMIC_BALLBAR",
    "PLANE",
    "NOMINAL_LENGTH",
    "PROGRAMMED_FEEDRATE",
    "A_AXIS_NAME",
    "B_AXIS_NAME",
)
_TYPES = {"UT_LENGTH_UM": 1.0, "UT_LENGTH_MM": 1e3, "UT_LENGTH_M": 1e6}


@dataclass(frozen=True)
class Run:
    """One recorded run.

    Attributes:
        direction: ``CW`` or ``CCW``, as the file has it.
        readings: (n,), in the order and unit of the file.
        unit: as an attribute of the readings names it, empty where none does.
        circularity: the file's own circularity of the run, µm; ``None`` where it has none.
    """

    direction: str
    readings: np.ndarray
    unit: str
    circularity: float | None

    @property
    def spread(self) -> float:
        """Circular deviation of the readings: largest minus smallest without mean and eccentricity, in the unit of the
        file.

        The readings are taken as evenly spaced over one, two or three turns, whichever explains more of them as
        eccentricity.
        """
        turn = np.linspace(0.0, 2 * np.pi, len(self.readings), endpoint=False)
        spreads = []
        for turns in (1, 2, 3):
            basis = np.column_stack([np.ones_like(turn), np.cos(turns * turn), np.sin(turns * turn)])
            spreads.append(np.ptp(self.readings - basis @ np.linalg.lstsq(basis, self.readings, rcond=None)[0]))
        return float(min(spreads))

    @property
    def gap(self) -> float:
        """How far the last reading is from the first, as a part of the readings' range."""
        return float(abs(self.readings[-1] - self.readings[0]) / (np.ptp(self.readings) or 1.0))


@dataclass(frozen=True)
class Recorded:
    """A ``.b5r`` file with its recorded runs.

    Attributes:
        path: the file.
        imported: its header and features.
        runs: its runs; none where the file has no readings.
        said: other elements of the test's description, as ``NAME text``: they are shown and not interpreted.
    """

    path: Path
    imported: Imported
    runs: tuple[Run, ...]
    said: tuple[str, ...]

    @property
    def plane(self) -> str:
        """The plane as mjsim names it, empty where the file's name does not say which way its circle turns."""
        name = "".join(self.imported.axes)
        return name if name in FIVE_AXIS.planes else ""

    @property
    def keys(self) -> dict:
        """Keys of a ``[[test]]`` table that the header gives; its length is taken for mm, its feed for mm/min."""
        out: dict = {"kind": "circular"}
        if self.plane:
            out["plane"] = self.plane
        for key, name in (("bar_length_mm", "nominal_length"), ("feed_mm_min", "programmed_feedrate")):
            text = self.imported.header.get(name, "")
            if re.fullmatch(r"\d{1,6}(\.\d{1,6})?", text) and float(text) > 0:
                out[key] = float(text)
        return out

    def unit(self, run: Run, o: Options) -> tuple[float, str]:
        """µm that a reading of 1 stands for, and why.

        Args:
            run: one of the runs.
            o: what the user said; a unit or scale in it decides.

        Raises:
            InputError: nothing says the unit, or two statements contradict each other.
        """
        if o.um_per_volt is not None:
            return o.um_per_volt, f"{o.um_per_volt:g} µm for a reading of 1, as --scale says"
        if o.deviation_unit is not None:
            if o.deviation_unit == "V":
                raise InputError(f"{self.path}: the readings are said to be in V; say --scale UM_PER_VOLT")
            return LENGTH[o.deviation_unit][0] / UM, f"readings in {o.deviation_unit}, as --deviation-unit says"
        units = {name for r in self.runs if (name := self._concluded(r)[0])}
        if len(units) > 1:
            raise InputError(
                f"{self.path}: the readings of its runs agree with different units ({', '.join(sorted(units))}); "
                "say --deviation-unit um or mm, or --scale UM (µm for a reading of 1)"
            )
        name, why = self._concluded(run)
        return CANDIDATES[name], f"readings taken for {name}: {why} (--deviation-unit, --scale)"

    def _concluded(self, run: Run) -> tuple[str, str]:
        where = f"{self.path}: READINGS of run {run.direction}"
        fits = []
        if run.circularity is not None:
            fits = [
                name
                for name, um in CANDIDATES.items()
                if run.circularity / AGREES <= run.spread * um <= run.circularity * AGREES
            ]
            found = (
                f"without eccentricity they range over {run.spread:.4g}, the file's circularity is "
                f"{run.circularity:.4g} µm"
            )
            if not fits or (run.unit and run.unit not in fits):
                said = f"the file says {run.unit}; " if run.unit else ""
                raise InputError(
                    f"{where}: {said}{found}; allowed: a unit of {', '.join(CANDIDATES)} that fits both, or "
                    f"--deviation-unit um or mm, "
                    "or --scale UM (µm for a reading of 1)"
                )
            return fits[0], found
        if run.unit:
            return run.unit, "the file says so"
        raise InputError(
            f"{where}: neither a unit nor a circularity to conclude it from; say --deviation-unit um or mm, "
            "or --scale UM (µm for a reading of 1)"
        )


def read_recorded(path: Path) -> Recorded:
    """Header, features and runs of a ``.b5r`` file.

    Raises:
        InputError: the file is none, or readings are not numbers, have no direction, or come twice for one direction.
    """
    imported = read_b5r(path)
    root = parse_xml(path)
    runs = [_run(path, element, direction, imported) for element, direction in _elements(root)]
    for run in runs:
        if sum(r.direction == run.direction for r in runs) > 1:
            raise InputError(
                f"{path}: READINGS of more than one run {run.direction}; allowed: one run CW and one run CCW in a file"
            )
    return Recorded(path, imported, tuple(runs), tuple(_said(root)))


def _elements(root: Element):
    """Every READINGS element with the text of the nearest RUN_DIRECTION before it among its siblings."""
    for parent in root.iter():
        direction = ""
        for child in parent:
            if child.tag == "RUN_DIRECTION":
                direction = (child.text or "").strip()
            elif child.tag == "READINGS":
                yield child, direction


def _run(path: Path, element: Element, direction: str, imported: Imported) -> Run:
    if direction.upper() not in ("CW", "CCW"):
        found = f"RUN_DIRECTION {direction[:20]!r}" if direction else "no RUN_DIRECTION"
        raise InputError(
            f"{path}: READINGS behind {found}; allowed: RUN_DIRECTION CW or CCW before them, in the same element"
        )
    direction = direction.upper()
    words = (element.text or "").split()
    values = np.array([_number(w) for w in words])
    if not len(values) or not np.isfinite(values).all():
        bad = int(np.flatnonzero(~np.isfinite(values))[0]) if len(values) else -1
        found = f"reading {bad + 1} is {words[bad][:20]!r}" if len(values) else "no number"
        raise InputError(
            f"{path}: READINGS of run {direction}: {found}; allowed: numbers with a decimal point, separated by spaces"
        )
    return Run(direction, values, _unit(element), _circularity(imported, direction))


def _number(word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        return np.nan
    return value if abs(value) < _HUGE else np.nan


def _unit(element: Element) -> str:
    """The unit that an attribute of the readings names, as features have it or by a usual spelling."""
    for text in element.attrib.values():
        um = _TYPES.get(text.strip().upper())
        named = {"um": 1.0, "mm": 1e3}.get(unit_named(text, "deviation") or "")
        for name, factor in CANDIDATES.items():
            if factor in (um, named):
                return name
    return ""


def _circularity(imported: Imported, direction: str) -> float | None:
    """The file's circularity in µm: of the run, otherwise of the whole analysis, otherwise any."""
    values = [
        ({direction: 0, "": 1}.get(f.run.upper(), 2), f.value * _TYPES[f.type.upper()])
        for f in imported.features
        if f.name == "AF_CIRCULARITY" and f.type.upper() in _TYPES and not isinstance(f.value, str) and f.value > 0
    ]
    return min(values, key=lambda v: v[0])[1] if values else None


def _said(root: Element):
    """Elements of the test's description that nothing here reads, and the attributes of the readings; few, and
    short.
    """
    spec = next(root.iter("TEST_SPEC"), None)
    leaves = (
        [e for e in spec.iter() if e.tag not in _SPEC and (e.text or "").strip() and not len(e)]
        if spec is not None
        else []
    )
    attributes = [f"READINGS@{k} {v}" for e, _ in _elements(root) for k, v in e.attrib.items()]
    return [text[:60] for text in (*(f"{e.tag} {(e.text or '').strip()}" for e in leaves[:20]), *attributes[:6])]
