"""Reading machine.toml, and writing it back with the user's comments and order kept."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import AoT, InlineTable, Table

from mjsim.campaign.chain_file import chain_of_file, functional_points, placed
from mjsim.campaign.model import Campaign
from mjsim.campaign.schema import ControllerTable, machine_table
from mjsim.campaign.temperature import in_campaign
from mjsim.campaign.tolerance import check_tolerance
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.io.files import write_whole
from mjsim.io.inputs import shown
from mjsim.io.toml import check, parse, read_text
from mjsim.machine.chain import Chain, is_rotary
from mjsim.machine.control import Control, Controller, Law
from mjsim.machine.effect import Effect
from mjsim.machine.model import Drive, Machine
from mjsim.units import DEG, MM

# -- the ``[controller.NAME.AXIS]`` tables of a machine file -----------------------------------------------------------


def read_controllers(
    path: Path, tables: dict[str, Any], chain: Chain, gears: dict[str, float]
) -> dict[str, dict[str, Controller]]:
    """Controllers by name and axis.

    Args:
        path: The machine file, for messages.
        tables: Checked tables by name.
        chain: Axes of the machine.
        gears: Motor angle per axis position, by axis.

    Raises:
        InputError: A table has neither gains nor a law, or both.
    """
    out: dict[str, dict[str, Controller]] = {}
    for name, axes in tables.items():
        out[name] = {}
        for axis in chain.letters:
            table = getattr(axes, axis)
            if table is not None:
                unit = DEG if is_rotary(axis) else MM
                out[name][axis] = _controller(f"{path}: [controller.{name}.{axis}]", table, gears[axis] * unit)
    return out


def _controller(place: str, t: ControllerTable, angle: float) -> Controller:
    """One controller; ``angle`` is the motor's per mm or degree of the axis, rad."""
    law = None
    given = [k for k in ("R", "S", "T") if getattr(t, k) is not None]
    gains = [k for k in ("position_gain_per_s", "velocity_gain_Nms_per_rad") if getattr(t, k) is not None]
    if given and gains:
        raise InputError(f"{place}: {given[0]} and {gains[0]}; allowed: a law R, S, T or the gains of a cascade")
    if given:
        needed = ("R", "S", "T", "sample_time_s", "torque_per_V")
        if missing := [k for k in needed if not getattr(t, k)]:
            raise InputError(f"{place}: the key {missing[0]!r} is missing; a law needs {', '.join(needed)}")
        R, S, T = t.R or [], t.S or [], t.T or []
        if R[0] == 0.0:
            raise InputError(f"{place}: R = {R}; allowed: a first coefficient that is not 0")
        law = Law(tuple(R), tuple(s / angle for s in S), tuple(c / angle for c in T))
    elif len(gains) < 2:
        missing = next(k for k in ("position_gain_per_s", "velocity_gain_Nms_per_rad") if k not in gains)
        raise InputError(f"{place}: the key {missing!r} is missing")
    if t.clip_V is not None and t.clip_Nm is not None:
        raise InputError(f"{place}: clip_V and clip_Nm; allowed: one of the two")
    clip = np.inf if t.clip_Nm is None else t.clip_Nm
    if t.clip_V is not None and t.torque_per_V is not None:
        clip = t.clip_V * t.torque_per_V
    slow, every = t.position_sample_time_s, t.sample_time_s
    if slow and law is not None:
        raise InputError(f"{place}: position_sample_time_s and R; allowed: a cascade, whose set-points it holds")
    most = 2.0 / (t.position_gain_per_s or 1.0)
    if slow >= most:  # with a velocity loop without any lag
        raise InputError(
            f"{place}: position_sample_time_s = {slow:g}; allowed: below 2 / position_gain_per_s, {most:g}"
        )
    if slow and every and abs(slow / every - round(slow / every)) > 1e-6:
        raise InputError(f"{place}: position_sample_time_s = {slow:g}; allowed: multiples of sample_time_s, {every:g}")
    lag, delay, over = t.torque_lag_s, t.loop_delay_s, t.velocity_samples
    control = Control(every, lag, delay, clip, t.anti_windup, over, law, position_sample_time=slow)
    return Controller(
        t.position_gain_per_s or 1.0,
        (t.torque_per_V if law else t.velocity_gain_Nms_per_rad) or 1.0,
        t.integral_time_s,
        t.velocity_feedforward,
        control,
    )


#: Numbers of a controller that a fit may change -> its key in the machine file.
CONTROLLER_KEYS = {
    "position_gain": "position_gain_per_s",
    "velocity_gain": "velocity_gain_Nms_per_rad",
    "integral_time": "integral_time_s",
    "feedforward": "velocity_feedforward",
}
CONTROL_KEYS = {
    "torque_lag": "torque_lag_s",
    "loop_delay": "loop_delay_s",
    "velocity_samples": "velocity_samples",
}


def edit_controllers(document: Any, now: dict[str, dict[str, Controller]], base: dict[str, dict[str, Controller]]):
    """Put changed numbers of controllers into the parsed machine file ``document``."""
    for name, axes in now.items():
        for axis, controller in axes.items():
            table, former = document["controller"][name][axis], base[name][axis]
            law = controller.control.law is not None
            for attribute, key in CONTROLLER_KEYS.items():
                value = getattr(controller, attribute)
                if value != getattr(former, attribute):
                    table["torque_per_V" if law and attribute == "velocity_gain" else key] = float(f"{value:.9g}")
            for attribute, key in CONTROL_KEYS.items():
                value = getattr(controller.control, attribute)
                if value != getattr(former.control, attribute):
                    table[key] = value if isinstance(value, int) else float(f"{value:.9g}")


#: Attribute of a drive -> its key in machine.toml.
DRIVE_KEYS = {
    "position_gain": "position_gain_per_s",
    "velocity_gain": "velocity_gain_Nms_per_rad",
    "integral_time": "integral_time_s",
    "inertia": "inertia_kgm2",
    "viscous": "viscous_Nms_per_rad",
    "gravity": "gravity_Nm",
}


def machine_of(campaign: Campaign, file: str | Path | None = None) -> Machine:
    """The campaign's machine, or the one in ``file``, with the campaign's temperatures.

    Raises:
        InputError: The file cannot be read, or is no machine, or it follows a sensor that the campaign lacks.
    """
    return in_campaign(read_machine(file if file is not None else campaign.machine_file), campaign)


def read_machine(path: str | Path, text: str | None = None) -> Machine:
    """Read a machine file, or ``text`` as if it stood there.

    Raises:
        InputError: names the file, the table and key, what was found and what is allowed.
    """
    path = Path(path)
    data = parse(path, text)
    chain = chain_of_file(path, data)
    table: Any = check(path, machine_table(chain), data)
    drives, gears = {}, {}
    for axis in chain.letters:
        d = getattr(table.drive, axis)
        want, other = ("worm_teeth", "lead_mm") if is_rotary(axis) else ("lead_mm", "worm_teeth")
        if getattr(d, other) is not None:
            raise InputError(
                f"{path}: [drive.{axis}] unknown key {other!r}; a {'rotary' if is_rotary(axis) else 'linear'} axis "
                f"has {want!r}"
            )
        if getattr(d, want) is None:
            raise InputError(f"{path}: [drive.{axis}]: the key {want!r} is missing")
        gears[axis] = d.worm_teeth if is_rotary(axis) else 2 * np.pi / (d.lead_mm * MM)
    controllers = read_controllers(path, table.controller, chain, gears)
    for axis in chain.letters:
        d, ran = getattr(table.drive, axis), [c[axis] for c in controllers.values() if axis in c]
        numbers = {k: getattr(d, v) for k, v in DRIVE_KEYS.items()}
        missing = [k for k, v in numbers.items() if v is None]
        if missing and not ran:
            raise InputError(f"{path}: [drive.{axis}]: the key {DRIVE_KEYS[missing[0]]!r} is missing")
        numbers |= {k: getattr(ran[0], k) for k in missing}
        drives[axis] = Drive(
            axis, gears[axis], **numbers, encoder=d.encoder, torque_constant=d.torque_constant_Nm_per_A or 0.0
        )
    effects: list[Effect] = []
    files: dict[str, str] = {}
    for number, entry in enumerate(table.effect, start=1):
        effect = _effect(path, number, dict(entry), files, chain)
        if any(effect.key == e.key for e in effects):
            raise InputError(f'{path}: [[effect]] "{effect.id}" appears twice; allowed: once (or one per direction)')
        effects.append(effect)
    check_tolerance(path, table.tolerance, tuple(effects), chain)
    factor = table.identify.factor if table.identify else None
    tolerance, configuration = table.tolerance, table.configuration
    machine = Machine(table.name, drives, tuple(effects), path, configuration, files, tolerance, controllers, factor)
    placements, tool_length = placed(table)
    machine = replace(machine, placements=placements, tool_length=tool_length, singular=table.singular_pass)
    return replace(machine, functional_points=functional_points(table))


def _effect(path: Path, number: int, entry: dict[str, Any], files: dict[str, str], chain: Chain) -> Effect:
    effect_id, source = entry.pop("id", None), entry.pop("file", None)
    if not isinstance(effect_id, str):
        raise InputError(f"{path}: [[effect]] number {number}: the key 'id' is missing or not a text")
    if len(effect_id) > 200 or not effect_id.isprintable():
        raise InputError(f"{path}: [[effect]] number {number}: id = {shown(effect_id)} is no effect's name")
    if source is not None and (not isinstance(source, str) or not source.strip() or not source.isprintable()):
        raise InputError(
            f"{path}: [[effect]] number {number}: file = {shown(source)}; allowed: the path of a Python file (.py)"
        )
    cls = None
    try:
        if source is not None:
            cls = registry.load_file(path.parent / str(source))
            kind, _, subject = effect_id.partition(".")
            others = {f for i, f in files.items() if i.partition(".")[0] == kind and f != source}
            if others:
                raise InputError(f"{source} and {others.pop()} both define the kind {kind!r}; give one another kind")
            files[effect_id] = str(source)
            if kind != cls.kind:
                raise InputError(f"id {effect_id!r} does not belong to {source}, which defines {cls.kind!r}")
            if subject not in (allowed := cls.subjects_of(chain)):
                raise InputError(f"unknown effect {effect_id!r}; {kind} exists for: {', '.join(allowed)}")
        else:
            cls, subject = registry.effect_class(effect_id, chain)
        allowed = [p.name for p in cls.parameters_of(subject)]
        for name in entry:
            if name not in allowed:
                raise InputError(
                    f"effect {effect_id}: unknown parameter {shown(name)}; allowed: {', '.join(allowed) or 'none'}"
                )
        return cls(subject, **entry)
    except InputError as error:
        hint = f"; `mjsim remove` takes {effect_id} out" if source is not None and cls is None else ""
        raise InputError(f'{path}: [[effect]] "{effect_id}": {error}{hint}') from None


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, list):
        return [_rounded(v) for v in value]
    return value


def machine_document(machine: Machine, original: Path, former: str | None = None) -> str:
    """TOML text of ``machine`` made by editing the text of ``original`` (or ``former``), so that comments and order
    stay.
    """
    former = read_text(original) if former is None else former
    document = tomlkit.parse(former)
    base = read_machine(original, former)
    for axis in machine.chain.letters:
        for attribute, key in DRIVE_KEYS.items():
            value = getattr(machine.drives[axis], attribute)
            if value != getattr(base.drives[axis], attribute):
                document["drive"][axis][key] = _rounded(value)
    edit_controllers(document, machine.controllers, base.controllers)
    if "effect" not in document:
        document.append("effect", tomlkit.aot())
    tables = document["effect"]
    keys = {e.key: e for e in machine.effects}
    for index in reversed(range(len(base.effects))):
        effect = keys.get(base.effects[index].key)
        if effect is None:
            del tables[index]
            continue
        for name, value in effect.values.items():
            if base.effects[index].values.get(name) != value:
                tables[index][name] = _rounded(value)
    have = {e.key for e in base.effects}
    for effect in machine.effects:
        if effect.key not in have:
            inline = not isinstance(tables, AoT)
            if not inline and len(tables) and not tables[-1].as_string().endswith("\n\n"):
                tables[-1].add(tomlkit.nl())
            tables.append(_new_table(effect, machine, inline))
    if not machine.effects and not base.effects and "effect" not in tomlkit.parse(former):
        del document["effect"]
    text = tomlkit.dumps(document)
    return text.replace("\r\n", "\n").replace("\n", "\r\n") if "\r\n" in former else text


def _new_table(effect: Effect, machine: Machine, inline: bool) -> Table | InlineTable:
    table = tomlkit.inline_table() if inline else tomlkit.table()
    table["id"] = effect.id
    if effect.id in machine.effect_files:
        table["file"] = machine.effect_files[effect.id]
    for name, value in effect.values.items():
        table[name] = _rounded(value)
    return table


def machine_text(machine: Machine, original: Path, folder: Path, former: str | None = None) -> str:
    """TOML text of ``machine`` as a file in ``folder``: as :func:`machine_document`, effect files named relative to
    ``folder``.
    """
    text = machine_document(machine, original, former)
    here, there = Path(original).resolve().parent, Path(folder).resolve()
    if machine.effect_files and here != there:
        document = tomlkit.parse(text)
        for table in document["effect"]:
            if "file" in table and not Path(table["file"]).is_absolute():
                with suppress(ValueError):  # Windows: on another drive, which no relative path reaches
                    table["file"] = Path(os.path.relpath(here / table["file"], there)).as_posix()
        text = tomlkit.dumps(document)
    return text


def text_without(path: Path, effect_id: str) -> str:
    """Text of a machine file less the effects of one id, whether their files can be loaded or not; the same text
    where there is none.
    """
    text = read_text(path)
    parse(path, text)  # says what is wrong where it is no TOML
    document = tomlkit.parse(text)
    tables = document.get("effect", [])
    for index in reversed(range(len(tables))):
        if tables[index].get("id") == effect_id:
            del tables[index]
    return tomlkit.dumps(document)


def write_machine(machine: Machine, original: Path, target: Path, force: bool = False) -> None:
    """Write ``machine`` to ``target`` as an edit of ``original``; the file appears whole or not at all.

    Effect files that ``original`` names relative to itself are named by their full path in another folder.
    """
    text = machine_document(machine, original)
    here, there = Path(original).resolve().parent, Path(target).resolve().parent
    if machine.effect_files and here != there:
        document = tomlkit.parse(text)
        for table in document["effect"]:
            if "file" in table:
                table["file"] = str(here / table["file"])
        text = tomlkit.dumps(document)
    write_whole(target, text, force=force)
