"""Renishaw Ballbar 20 ``.b5r``: header and diagnosed features.

The format is not published. What is read here is what parsers in public repositories agree on: attributes
``TEST_SPEC@NAME``, ``PLANE@TEST_PLANE`` and ``MACHINE_TESTED@NAME``; elements ``A_AXIS_NAME``, ``B_AXIS_NAME``,
``OPERATOR``, ``DATE_STARTED``, ``SERIAL_NUMBER``, ``LAST_CALIBRATED``; results as ``FEATURE`` with ``NAME``, ``DT``
(data type) and the value as text. The recorded runs are read in :mod:`mjsim.importing.b5r`. No real file has been
tried.
"""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from mjsim.errors import InputError
from mjsim.importing.reading import Options
from mjsim.importing.units import LENGTH, unit_named
from mjsim.io.inputs import file_bytes
from mjsim.machine.chain import FIVE_AXIS
from mjsim.units import UM

_LARGEST = 10_000_000
#: Data type -> unit as it is shown. The factors to other units are left to whoever converts.
UNITS = {
    "UT_LENGTH_UM": "µm", "UT_LENGTH_MM": "mm", "UT_LENGTH_M": "m", "UT_SQUARENESS": "µm/m", "UT_SERVO_MISMATCH": "ms",
    "UT_FEEDRATE": "mm/min", "UT_SPEED": "mm/s", "UT_ANGLE": "°", "UT_PERCENT": "%", "UT_SCALE_ERROR": "ppm",
    "UT_RANKING": "",
}  # fmt: skip
_ATTRIBUTES = {"test": ("TEST_SPEC", "NAME"), "plane": ("PLANE", "TEST_PLANE"), "machine": ("MACHINE_TESTED", "NAME")}
_ELEMENTS = {
    "operator": "OPERATOR",
    "date_started": "DATE_STARTED",
    "serial_number": "SERIAL_NUMBER",
    "last_calibrated": "LAST_CALIBRATED",
    "programmed_feedrate": "PROGRAMMED_FEEDRATE",
    "nominal_length": "NOMINAL_LENGTH",
}
_PLANES = {a + b for a in FIVE_AXIS.linear for b in FIVE_AXIS.linear if a != b}


@dataclass(frozen=True)
class Feature:
    """One diagnosed feature.

    Attributes:
        name, type: as in the file. value: a number, or the text where it is none. unit: as shown, empty where the type
            is not known.
        run: direction of the run that it belongs to, empty where it belongs to none. analysis: the analysis that it
            belongs to.
    """

    name: str
    type: str
    value: float | str
    unit: str
    run: str = ""
    analysis: str = ""


@dataclass(frozen=True)
class Imported:
    """A file of another system: where it came from, its header, the letters of its first and second axis, its
    features.
    """

    source: str
    header: dict[str, str]
    axes: tuple[str, ...]
    features: tuple[Feature, ...]

    def to_json(self) -> dict:
        """As it is kept in the campaign's folder ``imported``."""
        return {
            "source": self.source,
            "header": self.header,
            "axes": list(self.axes),
            "features": [asdict(f) for f in self.features],
        }


def looks_like_xml(path: Path) -> bool:
    """Whether a file is XML rather than a table, by its first bytes."""
    if path.suffix.lower() == ".b5r" or not path.is_file():
        return path.suffix.lower() == ".b5r"
    with open(path, "rb") as file:
        return file.read(64).lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n\0").startswith(b"<")


def parse_xml(path: Path) -> Element:
    """Root element of a ``.b5r`` file.

    Raises:
        InputError: it is no XML.
    """
    data = file_bytes(path, _LARGEST, f"allowed: a .b5r file of up to {_LARGEST / 1e6:.0f} MB")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(
            f"{path}: not valid XML: {error}; allowed: a .b5r file, which is XML, or a table as text"
        ) from None


def read_b5r(path: Path) -> Imported:
    """Header and features of a ``.b5r`` file.

    Raises:
        InputError: it is no XML, or holds neither features nor readings.
    """
    root = parse_xml(path)
    features = tuple(_features(root))
    header = _header(root)
    if not features and next(root.iter("READINGS"), None) is None:
        raise InputError(
            f"{path}: XML without any FEATURE element (root {root.tag[:40]!r}); allowed: a .b5r file with "
            f"diagnosed features"
        )
    return Imported(path.name, header, _axes(root, header), features)


def _header(root: Element) -> dict[str, str]:
    out = {}
    for key, (tag, attribute) in _ATTRIBUTES.items():
        element = next(root.iter(tag), None)
        if element is not None and element.get(attribute):
            out[key] = str(element.get(attribute)).strip()
    for key, tag in _ELEMENTS.items():
        element = next(root.iter(tag), None)
        if element is not None and (element.text or "").strip():
            out[key] = str(element.text).strip()
    return out


def _axes(root: Element, header: dict[str, str]) -> tuple[str, ...]:
    """Letters of the first and second axis: as the file names them, otherwise the plane's; none where neither is
    known.
    """
    named = tuple(
        (next(root.iter(tag), Element(tag)).text or "").strip().upper() for tag in ("A_AXIS_NAME", "B_AXIS_NAME")
    )
    plane = header.get("plane", "").upper()
    return named if "".join(named) in _PLANES else tuple(plane) if plane in _PLANES else ()


def _features(element: Element, run: str = "", analysis: str = ""):
    """All features below an element, with the run and the analysis that they stand in."""
    direction = element.find("RUN_DIRECTION")
    if direction is not None and direction.text:
        run = direction.text.strip()
    if element.tag == "ANALYSIS":
        analysis = element.get("NAME", "")
    for child in element:
        if child.tag == "FEATURE":
            kind = child.get("DT", "").strip()
            yield Feature(
                child.get("NAME", "").strip(), kind, _value(child.text), UNITS.get(kind.upper(), ""), run, analysis
            )
        yield from _features(child, run, analysis)


def _value(text: str | None) -> float | str:
    text = (text or "").strip()
    try:
        value = float(text)
    except ValueError:
        return text
    return value if math.isfinite(value) else text


# -- the recorded runs inside a ``.b5r`` file, and the unit of their readings ------------------------------------------
# A public reader of such files takes the numbers from ``READINGS`` elements, separated by spaces, each behind a sibling
# ``RUN_DIRECTION``. That is all that is known: unit, spacing and first angle of the readings are not published.

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
