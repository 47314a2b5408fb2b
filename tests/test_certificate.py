"""The certificate: what it says, its pages, and what it refuses."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

import mjsim
from mjsim.errors import InputError
from mjsim.report.certificate import Certificate, Table, certificate, drawn, make_certificate
from tests.independent import sphere


@pytest.fixture(scope="module")
def probed(tmp_path_factory):
    """The diagnosis of a machine that was probed, and its campaign's folder."""
    folder = tmp_path_factory.mktemp("probed")
    sphere.write(folder, 1)
    campaign = mjsim.read_campaign(folder)
    return mjsim.diagnose(campaign, mjsim.read_machine(campaign.machine_file)), folder


def cells(made, title):
    (table,) = (t for t in made.tables if t.title == title)
    return {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}


def test_numbers_have_their_uncertainty_limit_and_probability(probed):
    result, _ = probed
    made = certificate([replace(result, campaign=replace(result.campaign, serial_number="4711"))])
    assert ("Serial number", "4711") in made.about and any(name == "Touch probe" for name, _ in made.about)
    rows = cells(made, "Errors of the machine")
    assert len(rows) > 10
    for b in result.budget:
        row = rows.get(f"{b.effect_id} {b.number}")
        if row is None:
            continue
        value, half = (float(x) for x in row["Value"].split(" ± "))
        assert half == pytest.approx(2.0 * b.standard, rel=0.06) and value == pytest.approx(b.value, abs=0.06 * half)
        assert row["Decision"] == b.decision and float(row["Limit"].removeprefix("± ")) == pytest.approx(b.limit)
    files = cells(made, f"What went in: {result.campaign.name}")
    assert {"campaign.toml", "machine.toml", "traces/points.csv", "fitted machine"} <= set(files)
    assert all(len(row["SHA-256"]) == 64 for row in files.values())


def test_as_found_and_as_left_stand_side_by_side(probed):
    result, _ = probed
    left = replace(result, budget=tuple(replace(b, value=0.5 * b.value) for b in result.budget))
    made = certificate([result, left])
    assert [name for name, _ in made.answers] == ["as found", "as left"]
    rows = cells(made, "Errors of the machine")
    assert all({"As found", "As left"} <= row.keys() for row in rows.values())
    assert any(row["As found"] != row["As left"] for row in rows.values())


def test_it_has_one_or_two_pages_and_is_the_same_every_time(probed):
    result, _ = probed
    made = certificate([result, result])
    assert 1 <= len(drawn(made)) <= 2
    assert made.pdf() == made.pdf() and made.pdf().startswith(b"%PDF")


def test_long_tables_go_on_with_their_heads():
    table = Table("Long", ["Name", "Value"], [[f"row {i}", str(i)] for i in range(120)])
    first, second, *_ = drawn(Certificate("Title", [], [], [table]))
    assert [t.get_text() for t in second.texts][:2] == ["Name", "Value"]
    assert all(0.0 < t.get_position()[1] < 1.0 for figure in (first, second) for t in figure.texts)


def test_what_it_refuses(probed):
    result, _ = probed
    with pytest.raises(InputError, match="of two, as found and as left; found: 3"):
        make_certificate([result.campaign] * 3, result.machine)
    logs = SimpleNamespace(has_bars=False, at_rest=(), campaign=result.campaign)
    with pytest.raises(InputError, match="needs ball-bar tests, R-test readings, sphere tests or position tests"):
        certificate([logs])
