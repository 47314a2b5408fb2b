"""Other systems' diagnosed features beside mjsim's own findings: kept in the campaign's folder ``imported``, one
JSON file each.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from mjsim.campaign.model import Campaign
from mjsim.errors import InputError
from mjsim.importing.b5r import Feature, Imported, read_b5r
from mjsim.importing.into_campaign import campaign_file, test_name
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io.files import check_writable, write_all
from mjsim.io.inputs import file_bytes
from mjsim.machine.chain import FIVE_AXIS
from mjsim.units import unit_of

#: Feature -> the effects that cause it in mjsim's catalogue. {a}, {b}: first and second axis of the plane; {own},
#: {other}: the axis that the feature's name ends in, and the other one; {plane}: as mjsim names it.
_CAUSES: tuple[tuple[re.Pattern, tuple[str, ...]], ...] = (
    (re.compile(r"AF_SQUARENESS"), ("squareness.{plane}",)),
    (re.compile(r"AF_BACKLASH_([AB])_(POS|NEG)"), ("backlash.{own}",)),
    (re.compile(r"AF_REVERSAL_SPIKES_([AB])_(POS|NEG)"), ("friction.{own}",)),
    (re.compile(r"AF_CYCLIC_ERROR_([AB])_(FWD|REV)"), ("pitch_error.{own}",)),
    (re.compile(r"AF_SCALE_MISMATCH"), ("scale_error.{a}", "scale_error.{b}")),
    (re.compile(r"AF_SERVO_MISMATCH"), ("servo_gain.{a}", "servo_gain.{b}", "servo_delay.{a}", "servo_delay.{b}")),
    (re.compile(r"AF_STRAIGHTNESS_([AB])"), ("straightness.E{other}{own}",)),
    (re.compile(r"AF_LATERAL_PLAY_([AB])_(POS|NEG)"), ()),
)
_LARGEST = 20_000_000
_CIRCULARITY = "AF_CIRCULARITY"
_PLANES = {frozenset(plane): plane for plane in FIVE_AXIS.planes}


def features_folder(campaign: Campaign | str | Path) -> Path:
    """Where a campaign keeps what was imported of other systems' findings."""
    return (campaign.folder if isinstance(campaign, Campaign) else campaign_file(Path(campaign)).parent) / "imported"


def import_features(
    campaign: str | Path, files: Sequence[str | Path], force: bool = False, preview: bool = False
) -> list[Imported]:
    """Bring header and features of ``.b5r`` files into a campaign's folder ``imported``: all of them, or none.

    Raises:
        InputError: a file is no ``.b5r``, or is there already and ``force`` is false.
    """
    read = read_features(campaign, files)
    if not preview:
        for path in read:
            check_writable(path, force)
        write_all({p: json.dumps(i.to_json(), indent=1, ensure_ascii=False) + "\n" for p, i in read.items()}, force)
    return list(read.values())


def read_features(campaign: str | Path, files: Sequence[str | Path]) -> dict[Path, Imported]:
    """``.b5r`` files by the file of the campaign that would keep each.

    Raises:
        InputError: a file is no ``.b5r``, or two have the same name.
    """
    folder = features_folder(campaign)
    read = {folder / f"{test_name(Path(f))}.json": read_b5r(Path(f)) for f in files}
    if len(read) < len(files):
        raise InputError(f"{files[-1]}: another of these files has the same name; allowed: file names that differ")
    return read


def imported_features(campaign: Campaign | str | Path) -> list[Imported]:
    """What was imported of other systems' findings, by file name; empty where nothing was.

    Raises:
        InputError: a file of the folder ``imported`` is damaged.
    """
    out = []
    folder = features_folder(campaign)
    for path in sorted(folder.glob("*.json")) if folder.is_dir() else ():
        try:
            data = file_bytes(path, _LARGEST, f"allowed: up to {_LARGEST / 1e6:.0f} MB")
            out.append(TypeAdapter(Imported).validate_python(json.loads(data)))
        except InputError:
            raise
        except ValueError:
            raise InputError(
                f"{path}: not features that `mjsim import` has written; move it away and import the file again"
            ) from None
    return out


def causes(feature: Feature, axes: Sequence[str]) -> tuple[str, ...] | None:
    """Ids of the effects that mjsim gives as the cause: empty where it has none, ``None`` where the feature's
    meaning is not known.
    """
    for pattern, ids in _CAUSES:
        m = pattern.fullmatch(feature.name)
        if m is None:
            continue
        plane = _PLANES.get(frozenset(axes), "")
        if ids and not plane:
            return None
        own = axes["AB".index(m[1])] if m.groups() else ""
        other = next((x for x in axes if x != own), "")
        a, b = axes if plane else ("", "")
        return tuple(i.format(a=a, b=b, own=own, other=other, plane=plane) for i in ids)
    return None


def beside(
    imported: Iterable[Imported],
    effects: Mapping[str, Mapping[str, Any]],
    circles: Iterable[tuple[str, str, str, float]] = (),
) -> list[dict]:
    """Every feature with what mjsim says of the same: rows as plain data.

    Args:
        imported: from :func:`imported_features`.
        effects: id -> parameters, of effects found or in the model.
        circles: plane, direction (empty for both), name and measured circular error (µm) of the campaign's circular
            tests.

    Returns:
        Dictionaries with ``source``, ``feature``, ``run``, ``value``, ``unit``, ``axes``, ``causes`` (ids, or ``None``
        where the meaning is not known) and ``mjsim``: texts such as ``"backlash.X 2 µm"``. Signs are not compared: the
        other system's are not published.
    """
    circles = list(circles)
    rows = []
    for i in imported:
        plane = _PLANES.get(frozenset(i.axes), "")
        for f in i.features:
            ids = causes(f, i.axes)
            own = [f"{k} {leading(effects[k])}" for k in ids or () if k in effects]
            if f.name == _CIRCULARITY:
                ids = ()
                own = [f"G {g:.2f} µm {name}" for p, way, name, g in circles if p == plane and way == f.run.upper()]
            rows.append(
                {
                    "source": i.source,
                    "feature": f.name,
                    "run": f.run,
                    "value": f.value,
                    "unit": f.unit or f.type,
                    "axes": list(i.axes),
                    "causes": None if ids is None else list(ids),
                    "mjsim": own,
                }
            )
    return rows


def leading(parameters: Mapping[str, Any]) -> str:
    """The size of an effect in a word: its first parameter, or its largest component."""
    name, value = next(iter(parameters.items()))
    if name == "components":
        return f"largest of {len(value)} orders {max((row[1] for row in value), default=0.0):.3g}"
    return f"{value:.4g} {unit_of(name)[1]}".strip() if isinstance(value, (int, float)) else str(value)


def circles_of(campaign: Campaign, comparison: Mapping[str, Any]) -> list[tuple[str, str, str, float]]:
    """The argument ``circles`` of :func:`beside` from a comparison's JSON."""
    bars = campaign.of(BallBarTest.instrument).tests
    planes = {t.name: (plane, t.direction) for t in bars if (plane := kind_of(t).plane(t))}
    out = [
        (*planes[t["name"]], t["name"], t["iso230_4"]["measured"]["circular_error_um"])
        for t in comparison["tests"]
        if t["name"] in planes and t["iso230_4"]
    ]
    for b in comparison["iso230_4_bidirectional"]:
        if b["ccw"] in planes:
            out.append((planes[b["ccw"]][0], "", f"{b['ccw']}, {b['cw']}", b["measured"]["circular_error_um"]))
    return out
