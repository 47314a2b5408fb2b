"""``mjsim effects``."""

from __future__ import annotations

import click

from mjsim.cli import common
from mjsim.machine.chain import FIVE_AXIS, Chain
from mjsim.machine.effect import in_words


@click.command("effects")
@click.argument("effect", required=False, shell_complete=common.effect_ids)
@common.file_option("--machine", "machine_file", help="Machine file whose axes count (default: the shipped machine's).")
@common.options
def command(effect, machine_file) -> None:
    """The catalogue of effects, or one of them (an id such as backlash.A, or a kind such as backlash).

    \b
    Example: mjsim effects pitch_error.C
    """
    from mjsim.campaign.machine_file import read_machine
    from mjsim.effects import registry

    chain = FIVE_AXIS if machine_file is None else read_machine(machine_file).chain
    known = {k: c for k, c in registry.kinds().items() if c.subjects_of(chain)}
    if effect is None:
        if not common.answered({"effects": [describe(cls, None, chain) for cls in known.values()]}):
            rows = [[k, " ".join(c.subjects_of(chain)), c.title] for k, c in known.items()]
            common.table(["kind", "of", "what it is"], rows, text=(0, 1, 2))
            common.say("an effect's id is kind.SUBJECT; `mjsim effects KIND` or `mjsim effects ID` tells more")
        return
    cls, subject = (known[effect], None) if effect in known else registry.effect_class(effect, chain)
    data, subjects = describe(cls, subject, chain), cls.subjects_of(chain)
    if common.answered(data):
        return
    common.paragraph(
        f"{data['id'] if subject else cls.kind}: {data['title']}" + ("" if subject else f" ({', '.join(subjects)})")
    )
    click.echo()
    for word in ("subject", "definition", "source", "signature"):
        if data[word]:
            common.paragraph(f"{word}: {data[word]}")
    click.echo()
    rows = [
        [p["name"], p["unit"] or "–", "–" if p["neutral"] is None else f"{p['neutral']:g}", _allowed(p), p["meaning"]]
        for p in data["parameters"]
    ]
    common.table(["parameter", "unit", "neutral", "allowed", "meaning"], rows, text=(0, 1, 3, 4))
    if subject is None and any(cls.parameters_of(s) != cls.parameters_of(subjects[0]) for s in subjects):
        click.echo()
        common.paragraph(
            f"these are the parameters of {cls.kind}.{subjects[0]}; other axes' can differ: mjsim effects "
            f"{cls.kind}.{subjects[-1]}"
        )


def _allowed(p: dict) -> str:
    if p["kind"] == "choice":
        return " or ".join(p["choices"])
    return "list" if p["kind"] == "components" else f"{p['lower']:g} to {p['upper']:g}"


def describe(cls, subject: str | None, chain: Chain = FIVE_AXIS) -> dict:
    """An effect class as plain data, on a machine with these axes."""
    subjects = cls.subjects_of(chain)
    return {
        "id": f"{cls.kind}.{subject}" if subject else f"{cls.kind}.{{{','.join(subjects)}}}",
        "kind": cls.kind,
        "subjects": list(subjects),
        "title": cls.title,
        "subject": in_words(subject, chain) if subject else "",
        "definition": cls.definition,
        "source": cls.source,
        "signature": cls.signature,
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "meaning": p.meaning,
                "kind": p.kind,
                "neutral": p.neutral,
                "default": p.default,
                "lower": p.lower,
                "upper": p.upper,
                "choices": list(p.choices),
            }
            for p in cls.parameters_of(subject or subjects[0])
        ],
    }
