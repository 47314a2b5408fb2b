"""A new campaign's folder: commented files that run as they are."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomlkit

from mjsim.campaign.machine_templates import FACTOR, MachineTemplate
from mjsim.errors import InputError
from mjsim.io.files import check_writable, write_all
from mjsim.machine.chain import COORDINATES, SENSES, Axis, Chain, Placement, chain_of
from mjsim.machine.modelling import machine_xml, scene_xml
from mjsim.units import MM

# -- A new machine's folder --------------------------------------------------------------------------------------------

#: Drives of a small machining centre (assumed): comment behind each number.
_LINEAR = """[drive.{axis}]
lead_mm = 10.0                         # travel in one turn of the motor; CHANGE (5 to 20)
position_gain_per_s = 45.0             # Kpp, as set in the control; CHANGE (20 to 100)
velocity_gain_Nms_per_rad = 4.5        # Kvp, motor side (1 to 20)
integral_time_s = 0.012                # Ti of the velocity loop (0.005 to 0.05)
inertia_kgm2 = 0.0115                  # J of the whole axis at the motor shaft (0.001 to 0.1)
viscous_Nms_per_rad = 0.01             # C, motor side (0.001 to 0.05)
gravity_Nm = {gravity}                       # torque against gravity, motor side; 0 where nothing is lifted
"""
_ROTARY = """[drive.{axis}]
worm_teeth = 72                        # turns of the motor in one turn of the axis; CHANGE (40 to 180)
position_gain_per_s = 45.0
velocity_gain_Nms_per_rad = 1.5
integral_time_s = 0.012
inertia_kgm2 = 0.004
viscous_Nms_per_rad = 0.004
gravity_Nm = 0.0
"""
_FRICTION = (
    '[[effect]]\nid = "friction.{axis}"\ncoulomb_Nm = {coulomb}{source}\npresliding_rad = {presliding}{source}\n'
)


#: Drives of a template: every number is typical, none is the machine's.
_OF_TEMPLATE = """[drive.{axis}]
{gear:<38} # {meaning}; CHANGE
position_gain_per_s = {position_gain:<16g} # Kpp, as set in the control (1 m/min/mm is 16.7 1/s); CHANGE
velocity_gain_Nms_per_rad = {velocity_gain:<10g} # assumed
integral_time_s = {integral_time:<20g} # assumed
inertia_kgm2 = {inertia:<23g} # assumed
viscous_Nms_per_rad = {viscous:<16g} # assumed
gravity_Nm = {gravity:<25g} # assumed
"""
_MEANING = {
    "lead_mm": "travel in one turn of the motor, from the drawing",
    "worm_teeth": "turns of the motor in one turn of the axis, from the drawing",
}

#: What a machine file of axis logs has besides.
_OF_LOGS = """
# How far the numbers of the drives are believed: within this factor. Without it, as a data sheet's (2 to 10 %).
# [identify]
# factor = 5.0

# A control that is more than the gains above: one table for each of its settings and axes.
# [controller.normal.{axis}]
# position_gain_per_s = 45.0
# velocity_gain_Nms_per_rad = 4.5
# integral_time_s = 0.012              # inf: no integrator
# velocity_feedforward = 1.0
# torque_lag_s = 0.0
# loop_delay_s = 0.0
# sample_time_s = 0.001
# position_sample_time_s = 0.0         # where the velocity loop is the faster one; a multiple of sample_time_s
"""


def new_log_campaign(folder: str | Path, configuration: str, name: str | None = None) -> list[Path]:
    """Start a campaign of axis logs: campaign.toml, machine.toml and a folder for the recordings; all, or nothing.

    Args:
        folder: new, or empty.
        configuration: axes of the machine: those that are recorded are enough, e.g. ``"XY"`` or ``"C"``.
        name: of the campaign; the folder's when missing.

    Returns:
        The files.

    Raises:
        InputError: the configuration is none, or the folder holds something already.
    """
    folder = Path(folder)
    chain = chain_of(configuration, with_senses(configuration))
    name = check_new_folder(folder, name, "campaign")
    contents = {
        folder / "campaign.toml": log_campaign_text(name),
        folder / "machine.toml": machine_text(chain, name) + _OF_LOGS.format(axis=chain.letters[0]),
        folder / "traces" / "README.md": "Recordings of the axes. `mjsim import FILE --log` writes them here.\n",
    }
    return write_new(contents)


def log_campaign_text(name: str) -> str:
    """A commented campaign.toml of axis logs that has no test yet."""
    text = (TEMPLATE / "logs.toml").read_text(encoding="utf-8")
    return text.replace('"@NAME@"', json.dumps(name, ensure_ascii=False))


def machine_text(
    chain: Chain, name: str, template: MachineTemplate | None = None, position_gain: float | None = None
) -> str:
    """A commented machine file for a chain; its numbers are typical of a small machining centre, or of a template.

    Args:
        chain: the axes.
        name: of the machine.
        template: what the numbers are typical of; they are then believed within a factor only.
        position_gain: of all axes, 1/s, where the user knows it.
    """
    where = (
        "# The numbers are typical of a small machining centre. Take yours from the parameters of the control\n"
        "# and from the data sheets of the motors.\n\n"
        if template is None
        else f"# From the template {template.name}: {template.layout.words};\n# {template.size.words}.\n"
        "# No number is measured. What you know of your machine belongs in place of what is marked CHANGE.\n\n"
    )
    out = [
        f"# The model of the machine: its axes, its drives, and the effects that are already known.\n{where}"
        f"name = {json.dumps(name, ensure_ascii=False)}\n"
        f'configuration = "{chain.configuration}"\n'
    ]
    if chain.swivelling:
        length = f"tool_length_mm = {chain.tool_length / MM:g}"
        out.append(f"{length:<38} # from the pivot of the head to the ball; CHANGE\n")
    out.append("\n")
    if template is not None:
        out.append(
            f"# The assumed numbers are believed within this factor, so that a diagnosis fits them. Take it out once\n"
            f"# they come from data sheets (which are believed within some per cent).\n"
            f"[identify]\nfactor = {FACTOR:g}\n\n"
        )
    for axis in (a for a in chain.axes if a.rotary):
        out.append(axis_table(chain, axis))
    for axis in chain.axes:
        lifts = not axis.rotary and axis.along == 2
        if template is None:
            text = _ROTARY if axis.rotary else _LINEAR
            out.append(text.format(axis=axis.letter, gravity="3.0" if lifts else "0.0"))
        else:
            out.append(_template_drive(template, axis, lifts, position_gain))
        out.append("\n")
    out.append("# Effects that are in the model. Every machine has friction.\n")
    out.append("# `mjsim effects --machine FILE` lists all that this machine can have.\n\n")
    for axis in chain.axes:
        numbers = {"coulomb": 0.4, "presliding": 0.006} if axis.rotary else {"coulomb": 1.0, "presliding": 0.003}
        if template is not None:
            typical = template.drive(axis.letter)
            numbers = {"coulomb": typical.coulomb, "presliding": typical.presliding}
        source = "" if template is None else "  # assumed"
        out.append(_FRICTION.format(axis=axis.letter, source=source, **numbers) + "\n")
    return "".join(out).rstrip() + "\n"


def with_senses(
    configuration: str, placements: tuple[tuple[str, Placement], ...] = ()
) -> tuple[tuple[str, Placement], ...]:
    """Placements in which every rotary axis has a sense: that of ISO 841 where neither sense nor direction is stated.

    Args:
        configuration: axes from the workpiece to the tool.
        placements: what is stated.
    """
    stated = dict(placements)
    for letter in chain_of(configuration, placements).rotary:
        one = stated.get(letter, Placement())
        if one.sense is None and one.direction is None:
            stated[letter] = one._replace(sense=SENSES[0])
    return tuple(sorted(stated.items()))


def _template_drive(template: MachineTemplate, axis: Axis, lifts: bool, position_gain: float | None) -> str:
    """The table of one drive, with a source behind each number."""
    typical = dict(vars(template.drive(axis.letter)))
    key = "worm_teeth" if axis.rotary else "lead_mm"
    gear = f"{key} = {typical.pop('gear'):g}"
    gravity = typical.pop("lifted") if lifts else 0.0
    if position_gain is not None:
        typical["position_gain"] = position_gain
    return _OF_TEMPLATE.format(axis=axis.letter, gear=gear, meaning=_MEANING[key], gravity=gravity, **typical)


def turns_of(chain: Chain, letter: str) -> tuple[str, ...]:
    """How a positive position turns what a rotary axis carries, in words, in each of the senses."""
    axis = chain.axis(letter)
    carried = "tool" if axis in chain.tool else "workpiece"
    ways = ("counter-clockwise", "clockwise") if axis in chain.tool else ("clockwise", "counter-clockwise")
    return tuple(f"{letter}+ turns the {carried} {way}, seen against {COORDINATES[axis.along]}+" for way in ways)


def axis_table(chain: Chain, axis: Axis) -> str:
    """In which sense a rotary axis counts, and where it is; that is commented out at its nominal place."""
    pivot = chain.tool_length if axis in chain.tool else 0.0
    offset = [round(v / MM, 9) + 0.0 for v in (axis.point[0], axis.point[1], axis.point[2] - pivot)]
    away = "# " if not axis.tilted and not any(offset) else ""
    start = "the pivot of the head" if axis in chain.tool else "the origin of the work frame"
    own = chain.sense(axis.letter)
    sense, other = f'sense = "{own}"', SENSES[own == SENSES[0]]
    turns = turns_of(chain, axis.letter)[SENSES.index(own)]
    return (
        f"[axis.{axis.letter}]\n"
        f'{sense:<38} # {turns}; or "{other}"; CHANGE\n'
        f"{away}direction = [{', '.join(f'{v:.10g}' for v in axis.unit)}]    # of its centreline, all axes at 0\n"
        f"{away}offset_mm = [{', '.join(f'{v:g}' for v in offset)}]    # of the centreline from {start}\n\n"
    )


def new_machine(
    folder: str | Path,
    configuration: str,
    placements: tuple[tuple[str, Placement], ...] = (),
    tool_length: float | None = None,
    name: str | None = None,
    template: MachineTemplate | None = None,
    position_gain: float | None = None,
) -> list[Path]:
    """Write machine.toml and the model of a machine; all of it, or nothing.

    Args:
        folder: new, or empty.
        configuration: axes from the workpiece to the tool.
        placements: rotary axes that are tilted or offset, or whose sense is stated; the others count as ISO 841 says.
        tool_length: from the pivot of the head to the ball, m.
        name: of the machine; the folder's when missing.
        template: what its numbers are typical of.
        position_gain: of all its axes, 1/s, where a template is given.

    Returns:
        The files: machine.toml, and machine.xml and scene.xml where a ball bar can be held.

    Raises:
        InputError: the configuration is none, or the folder holds something already.
    """
    folder = Path(folder)
    chain = chain_of(configuration, with_senses(configuration, placements), tool_length)
    if tool_length is not None and not chain.swivelling:
        raise InputError(
            f"tool length {tool_length / MM:g} mm: the head of {configuration!r} does not turn; leave it out"
        )
    name = check_new_folder(folder, name, "machine")
    contents = {folder / "machine.toml": machine_text(chain, name, template, position_gain)}
    if chain.spatial:
        contents[folder / "machine.xml"] = machine_xml(chain, "machine")
        contents[folder / "scene.xml"] = scene_xml(chain, "machine.xml")
    return write_new(contents)


def check_position_gain(gain: float | None) -> None:
    """Refuse a position gain that no control has.

    Args:
        gain: 1/s, or ``None``.

    Raises:
        InputError: it is out of bounds.
    """
    if gain is not None and not 1.0 <= gain <= 1000.0:
        raise InputError(
            f"position gain {gain:g}; allowed: 1 to 1000 1/s (1 m/min/mm is 16.7 1/s; a Fanuc control counts in 0.01/s)"
        )


#: Folder of the files that a new campaign begins with.
TEMPLATE = Path(__file__).resolve().parent / "template"
#: A campaign of planned tests, before its tables.
_PLANNED = """# A campaign: the tests of one machine, in the order of measuring.
# Keys end in their unit. docs/campaign-format.md explains every key.
# When a test is measured: mjsim import FILE --campaign FOLDER --test NAME

name = {name}
machine = "machine.toml"

[instrument]
kind = "{kind}"
resolution_um = {resolution_um:g}
range_mm = {range_mm:g}
sample_rate_Hz = {sample_rate_Hz:g}
"""
#: Numbers of an ordinary ball bar.
BALL_BAR = {"resolution_um": 0.1, "range_mm": 1.0, "sample_rate_Hz": 200.0}
_FILES = {"machine.toml": "machine.toml", "README.md": "traces/README.md"}
#: Files that a campaign.toml begins as, by kind of the instrument.
CAMPAIGNS = {"ball_bar": "campaign.toml", "sphere": "sphere.toml", "positions": "positions.toml"}


def new_campaign(folder: str | Path, name: str | None = None, instrument: str = "ball_bar") -> list[Path]:
    """Start a campaign: campaign.toml, machine.toml and an empty folder for the traces; all of it, or nothing.

    Args:
        folder: new, or empty.
        name: of the campaign; the folder's when missing.
        instrument: that it begins with: ``ball_bar``, ``sphere`` or ``positions``.

    Returns:
        The files.

    Raises:
        InputError: the folder holds something already, or cannot be written.
    """
    folder = Path(folder)
    name = check_new_folder(folder, name, "campaign")
    files = {CAMPAIGNS[instrument]: "campaign.toml", **_FILES}
    texts = {place: (TEMPLATE / source).read_text(encoding="utf-8") for source, place in files.items()}
    if instrument != "ball_bar":
        texts["traces/README.md"] = "What was measured. `mjsim import FILE --points` writes it here.\n"
    contents = {
        folder / place: text.replace('"@NAME@"', json.dumps(name, ensure_ascii=False)) for place, text in texts.items()
    }
    return write_new(contents)


def planned_text(name: str, tests: Sequence[dict[str, Any]], kind: str = "ball_bar") -> str:
    """A campaign.toml of tests that are not measured yet.

    Args:
        name: of the campaign.
        tests: their tables, in the order of measuring; there may be none yet.
        kind: of the instrument.
    """
    text = _PLANNED.format(name=json.dumps(name, ensure_ascii=False), kind=kind, **BALL_BAR)
    return text + "".join("\n[[test]]\n" + tomlkit.dumps(t).rstrip() + "\n" for t in tests)


def new_planned_campaign(
    folder: str | Path, machine_file: str, tests: Sequence[dict[str, Any]], instrument: str | None = None
) -> list[Path]:
    """Start a campaign of planned tests: campaign.toml, machine.toml and a folder for the traces; all, or nothing.

    Args:
        folder: new, or empty.
        machine_file: text of the machine file.
        tests: tables of the tests.
        instrument: kind of it; a ball bar when missing.

    Returns:
        The files.

    Raises:
        InputError: the folder holds something already, or cannot be written.
    """
    folder = Path(folder)
    name = check_new_folder(folder, None, "campaign")
    contents = {
        folder / "campaign.toml": planned_text(name, tests, kind=instrument or "ball_bar"),
        folder / "machine.toml": machine_file,
        folder / "traces" / "README.md": (TEMPLATE / "README.md").read_text(encoding="utf-8"),
    }
    return write_new(contents)


def write_new(contents: dict[Path, str]) -> list[Path]:
    """Write the files of a new folder; all of them, or nothing.

    Args:
        contents: texts by file.

    Returns:
        The files.

    Raises:
        InputError: they cannot be written.
    """
    check_writable(next(iter(contents)))
    write_all(contents)
    return list(contents)


def check_new_folder(folder: Path, name: str | None, what: str) -> str:
    """The name of what is started in a folder, which has to be new or empty.

    Args:
        folder: new, or empty.
        name: as the user gives it; the folder's when missing.
        what: is started, for messages.

    Raises:
        InputError: the name is none, or the folder holds something already.
    """
    name = name if name is not None else folder.absolute().name
    if not name or not name.isprintable() or len(name) > 200:
        raise InputError(f"{folder}: {name[:60]!r} is no name for a {what}; give a printable one with --name")
    if folder.is_dir():
        inside = sorted(p.name for p in folder.iterdir())
        if inside:
            more = f" and {len(inside) - 1} more" if len(inside) > 1 else ""
            raise InputError(f"{folder}: is not empty, it holds {inside[0]!r}{more}; allowed: a new or an empty folder")
    elif os.path.lexists(folder):
        raise InputError(f"{folder}: exists already and is no folder; allowed: a new or an empty folder")
    return name
