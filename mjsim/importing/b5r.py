"""Renishaw Ballbar 20 ``.b5r``: header and diagnosed features.

The format is not published. What is read here is what parsers in public repositories agree on: attributes
``TEST_SPEC@NAME``, ``PLANE@TEST_PLANE`` and ``MACHINE_TESTED@NAME``; elements ``A_AXIS_NAME``, ``B_AXIS_NAME``,
``OPERATOR``, ``DATE_STARTED``, ``SERIAL_NUMBER``, ``LAST_CALIBRATED``; results as ``FEATURE`` with ``NAME``, ``DT``
(data type) and the value as text. The recorded runs are read in :mod:`mjsim.importing.b5r_runs`. No real file has been
tried.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from mjsim.errors import InputError
from mjsim.io.inputs import file_bytes
from mjsim.machine.chain import FIVE_AXIS

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
