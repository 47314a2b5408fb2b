"""The ``[acceptance]`` table of a campaign: limits of its tests' figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mjsim.errors import InputError
from mjsim.instruments.ball_bar.acceptance import BIDIRECTIONAL, RANGE, Acceptance, Limit
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.tables import AcceptanceTable
from mjsim.units import UM


def acceptance_of(file: Path, table: AcceptanceTable | None, tests: Sequence[BallBarTest]) -> Acceptance | None:
    """The limits that the table states; ``None`` without a table.

    Args:
        file: The campaign file, for messages.
        table: As it was read.
        tests: Of the campaign.

    Raises:
        InputError: a limit is for a test that does not exist, or for a figure that the test does not have.
    """
    if table is None:
        return None
    known = {t.name: t for t in tests}
    limits = []
    for number, row in enumerate(table.limit, start=1):
        place = f"{file}: [[acceptance.limit]] number {number}"
        for name in row.tests:
            if name not in known:
                raise InputError(f"{place}: there is no test {name!r}; allowed: {', '.join(known)}")
            round_ = kind_of(known[name]).goes_round
            if round_ == (row.figure == RANGE):
                allowed = "figures of ISO 230-4" if round_ else RANGE
                raise InputError(f"{place}: figure = {row.figure!r} of test {name!r}; allowed for it: {allowed}")
        if row.figure in BIDIRECTIONAL:
            ways = [known[n].direction for n in row.tests]
            if sorted(ways) != ["CCW", "CW"]:
                raise InputError(f"{place}: {row.figure} needs two tests, one CCW and one CW; found: {', '.join(ways)}")
        limits.append(Limit(tuple(row.tests), row.figure, row.um * UM, row.source))
    return Acceptance(tuple(limits), table.instrument_um * UM, table.probability)
