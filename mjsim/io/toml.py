"""Reading TOML with errors that name file, line or key, what was found and what is allowed."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mjsim.errors import InputError, probably_meant
from mjsim.io.inputs import file_bytes, shown

T = TypeVar("T", bound=BaseModel)
_LARGEST = 5_000_000


def read_text(path: Path) -> str:
    """Text of a small configuration file; a byte order mark is dropped."""
    data = file_bytes(path, _LARGEST, f"allowed: a TOML file of up to {_LARGEST / 1e6:.0f} MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8") from None


def parse(path: Path, text: str | None = None) -> dict:
    """The file's tables as plain Python; those of ``text`` where it is given, with ``path`` as the name in messages."""
    text = read_text(path) if text is None else text
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None


def check(path: Path, schema: type[T], data: dict) -> T:
    """Validate ``data`` against ``schema``; the first problem becomes one sentence."""
    try:
        return schema.model_validate(data)
    except ValidationError as error:
        problems = error.errors()
        # a misspelt key is also a missing one: the misspelling says more
        first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
        raise InputError(f"{path}: {_sentence(schema, data, first)}") from None


def _sentence(schema: type[BaseModel], data: dict, problem: ErrorDetails) -> str:
    place, owner = _place(data, problem["loc"])
    kind = problem["type"]
    if kind == "extra_forbidden":
        allowed = _keys(schema, problem["loc"][:-1])
        key = str(problem["loc"][-1])
        return f"{owner}unknown key {shown(key)}{probably_meant(key, allowed)}; allowed: {', '.join(allowed)}"
    if kind == "missing":
        key = str(problem["loc"][-1])
        field = _table_of(schema, problem["loc"][:-1]).model_fields.get(key)
        allowed = f"; allowed: {field.description}" if field is not None and field.description else ""
        return f"{owner}the key {key!r} is missing{allowed}"
    if kind in ("too_short", "too_long") and isinstance(problem["input"], list):
        least = kind == "too_short"
        count = problem.get("ctx", {})["min_length" if least else "max_length"]
        items = "1 item" if count == 1 else f"{count} items"
        return f"{place} has {len(problem['input'])}; allowed: at {'least' if least else 'most'} {items}"
    text = problem["msg"].replace("Input should be", "allowed:").replace("Input should have", "allowed: to have")
    return f"{place} = {shown(problem['input'])}; {text[0].lower() + text[1:]}"


def _place(data: dict, loc: tuple) -> tuple[str, str]:
    """Readable place of a value ('[[test]] "x50" feed_mm_min') and of the table that holds it."""
    words: list[str] = []
    node: Any = data
    for step in loc[:-1]:
        try:
            node = node[step]
        except (KeyError, IndexError, TypeError):
            node = None
        if isinstance(step, int):
            name = node.get("name") if isinstance(node, dict) else None
            words[-1] = f"[[{words[-1]}]] " + (
                f'"{name}"'
                if isinstance(name, str) and name.isprintable() and len(name) <= 60
                else f"number {step + 1}"
            )
        else:
            words.append(str(step))
    table = ".".join(words)
    if table and not table.startswith("["):
        table = f"[{table}]"
    last = loc[-1]
    item = f"item {last + 1}" if isinstance(last, int) else str(last)
    return f"{table} {item}".strip(), f"{table}: " if table else ""


def _keys(schema: type[BaseModel], loc: tuple) -> list[str]:
    return [field.alias or name for name, field in _table_of(schema, loc).model_fields.items()]


def _table_of(schema: type[BaseModel], loc: tuple) -> type[BaseModel]:
    """The schema of a table inside the file."""
    steps = iter(loc)
    for step in steps:
        if isinstance(step, int):
            continue
        annotation = schema.model_fields[step].annotation
        while not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            inner = [a for a in get_args(annotation) if a is not type(None)]
            if get_origin(annotation) is dict:
                next(steps, None)  # the name that the user gave to a table
            annotation = inner[-1] if get_origin(annotation) is dict else inner[0]
        schema = annotation
    return schema
