"""Axis logs of other systems: a German table, a MATLAB file, a table without a header; and mistakes noticed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from commands import refused, well_labelled

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.commands.compare import compare
from mjsim.errors import InputError
from mjsim.importing.logs import import_log
from mjsim.importing.reading import Options
from mjsim.instruments.axis_log.instrument import log_mistakes
from mjsim.io.resources import examples
from mjsim.plots.comparison import axis_figure
from tests.independent.logs import CAMPAIGN, Axis, Control, csv, machine_toml, record, to_and_fro

AXIS, PI = Axis(coulomb=0.12), Control(integral_time=0.04)


@pytest.fixture(scope="module")
def motion():
    command = to_and_fro()
    return command, *record(AXIS, PI, command)


@pytest.fixture
def folder(tmp_path, motion):
    (tmp_path / "machine.toml").write_text(machine_toml(AXIS, PI, identify=False, friction=0.12, integral_time=0.1))
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "strokes.csv").write_text(csv(*motion))
    return tmp_path


def german(command, actual, swapped):
    first, second = (actual, command) if swapped else (command, actual)
    rows = (f"{i};{1e3 * a:.6f};{1e3 * b:.6f}" for i, (a, b) in enumerate(zip(first, second, strict=True)))
    return ("Zeit [ms];X Soll [mm];X Ist [mm]\n" + "\n".join(rows) + "\n").replace(".", ",")


def run(*arguments):
    result = CliRunner().invoke(main, list(map(str, arguments)))
    return result.exit_code, result.output


def test_from_a_german_table_with_exchanged_columns_to_a_named_cause(folder, motion):
    """Decimal commas, time in ms, command and actual exchanged: noticed, imported right, and the cause is named."""
    source = folder / "messung.csv"
    source.write_text(german(motion[0], motion[1], swapped=True), encoding="cp1252")
    status, said = run("import", source, "--campaign", folder, "--log", "--controller", "c", "--preview")
    assert status == 0 and "exchanged" in said and "nothing was written" in said
    assert "--signal X_command=3:mm --signal X_actual=2:mm" in " ".join(said.split())
    assert not (folder / "traces").exists()
    table = (folder / "campaign.toml").read_text().replace('"strokes"', '"messung"')
    (folder / "campaign.toml").write_text(table.replace('trace = "strokes.csv"\n', ""))
    signals = ["--signal", "X_command=3:mm", "--signal", "X_actual=2:mm"]
    status, said = run("import", source, "--campaign", folder, "--log", "--controller", "c", *signals)
    assert status == 0 and "exchanged" not in said
    campaign = read_campaign(folder)
    assert [t.name for t in campaign.of("axis_log").measured] == ["messung"]
    imported = campaign.traces["messung"]
    assert imported.step == pytest.approx(1e-3)
    assert imported.axes["X"].actual == pytest.approx(motion[1], abs=1e-9)
    status, said = run("diagnose", folder, "--json")
    found = json.loads(said)
    assert status == 0 and found["effects"][0]["id"] == "integral_time.X"
    assert found["effects"][0]["parameters"]["ratio"] == pytest.approx(0.4, rel=0.05)


def test_the_first_log_of_a_campaign(folder, motion):
    """A campaign.toml that ends before its tests gets the table of the log."""
    head = (folder / "campaign.toml").read_text().partition("[[test]]")[0].strip() + "\n"
    (folder / "campaign.toml").write_text(head)
    (folder / "m.csv").write_text(german(motion[0], motion[1], swapped=False))
    assert import_log(folder, folder / "m.csv", controller="c").new_test
    assert (folder / "campaign.toml").read_text().startswith(head + "\n[[test]]\n")
    assert [t.name for t in read_campaign(folder).of("axis_log").measured] == ["m"]


def test_the_example_of_the_documentation(folder):
    """Its table fits its machine file: the log follows as far behind as the page says."""
    page = (Path(__file__).parents[1] / "docs" / "axis-logs.md").read_text(encoding="utf-8")
    machine = page.partition('```toml\nname = "my axis"')[2].partition("```")[0]
    (folder / "machine.toml").write_text('name = "my axis"' + machine)
    command = to_and_fro()
    axis = Axis(coulomb=0.12, ripple=0.02, ripple_order=3.0)
    position, _ = record(axis, Control(integral_time=0.34 * 0.08), command)
    (folder / "messung.csv").write_text(german(command, position, swapped=True))
    (said,) = import_log(folder, folder / "messung.csv", controller="normal", preview=True).questions
    assert f"look at this: {said}" in " ".join(page.split())


def test_a_controller_that_the_machine_file_does_not_state(folder, motion):
    """The log would be refused later, when it is compared."""
    (folder / "m.csv").write_text(german(motion[0], motion[1], swapped=False))
    said = refused(folder, ["import", folder / "m.csv", "--campaign", folder, "--log", "--controller", "fast"])
    assert "machine.toml: no controller 'fast' of X; allowed: c" in said


def test_the_picture_is_well_labelled(folder):
    (part,) = compare(read_campaign(folder), read_machine(folder / "machine.toml")).parts
    (test,) = part.tests
    assert all(well_labelled(axis_figure(test, axis)) for axis in test.channels)


def test_a_campaign_of_ball_bar_tests_gets_a_recorder(folder, motion):
    """A ball bar's instrument stands for no log. What would be refused later is not written."""
    head = (folder / "campaign.toml").read_text().partition("[instrument]")[0]
    bar = """[[test]]\nname = "c"\nkind = "circular"\nplane = "XY"\ndirection = "CCW"\nbar_length_mm = 100.0
table_ball_mm = [0.0, 0.0, 100.0]\nfeed_mm_min = 1000.0\n"""
    instrument = '[instrument]\nkind = "ball_bar"\nresolution_um = 0.2\n\n'
    (folder / "campaign.toml").write_text(head + instrument + bar)
    (folder / "machine.toml").write_bytes((examples() / "healthy" / "machine.toml").read_bytes())
    (folder / "m.csv").write_text(german(motion[0], motion[1], swapped=False))
    before = (folder / "campaign.toml").read_text()
    with pytest.raises(InputError, match='"c" appears 2 times'):
        import_log(folder, folder / "m.csv", test="c")
    assert (folder / "campaign.toml").read_text() == before and not (folder / "traces").exists()
    assert import_log(folder, folder / "m.csv").questions == ()
    campaign = read_campaign(folder)
    assert [t.name for t in campaign.of("axis_log").measured] == ["m"]
    assert [t.name for t in campaign.tests] == ["c", "m"]
    assert campaign.instruments["axis_log"].rate == pytest.approx(1000.0)
    assert campaign.instruments["ball_bar"].resolution == 0.2e-6


def test_commands_refuse_exchanged_columns(folder, motion):
    (folder / "strokes.csv").write_text(csv(motion[1], motion[0]))
    status, said = run("compare", folder, "--no-plots")
    assert status == 1 and "exchanged" in said
    status, said = run("check", folder)
    assert status == 0 and "exchanged" in said


def test_a_matlab_file(folder, motion):
    from scipy.io import savemat

    source = folder / "run.mat"
    savemat(source, {"t": 1e-3 * np.arange(len(motion[0])), "Y": {"x_ref": 1e3 * motion[0], "x_enc": 1e3 * motion[1]}})
    signals = ("X_command=Y.x_ref:mm", "X_actual=Y.x_enc:mm")
    found = import_log(folder, source, signals=signals, controller="c")
    assert found.test == "run" and found.questions == ()
    assert read_campaign(folder).traces["run"].axes["X"].command == pytest.approx(motion[0], abs=1e-9)
    (folder / "bad.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(InputError, match="no readable MATLAB file"):
        import_log(folder, folder / "bad.mat", signals=signals)


def test_a_table_without_a_header_or_a_time(folder, motion):
    """As a sampler writes it: numbers separated by spaces."""
    source = folder / "sampler.txt"
    source.write_text("\n".join(f"{1e3 * a:.6f} {1e3 * b:.6f}" for a, b in zip(motion[0], motion[1], strict=True)))
    with pytest.raises(InputError, match="--time COLUMN or --rate HZ"):
        import_log(folder, source)
    found = import_log(folder, source, signals=("X_command=1:mm", "X_actual=2:mm"), options=Options(rate=1000.0))
    assert found.rate == pytest.approx(1000.0)


@pytest.mark.parametrize(
    ("signal", "said"),
    [("Q_command=1:mm", "an axis of X"), ("X_position=1:mm", "a signal of"), ("X_command=9:mm", "no column '9'")],
)
def test_wrong_signals(folder, motion, signal, said):
    source = folder / "m.csv"
    source.write_text(german(motion[0], motion[1], swapped=False))
    with pytest.raises(InputError, match=said):
        import_log(folder, source, signals=(signal,))


def test_units_and_times_that_cannot_be(folder):
    logs = read_campaign(folder)
    recording = logs.traces["strokes"]
    record = recording.axes["X"]

    def found(recording):
        return log_mistakes(logs.measured, {"strokes": recording}, logs.instrument.rate)

    assert found(recording) == []
    inch = replace(recording, axes={"X": replace(record, actual=record.actual / 25.4)})
    assert "inch" in found(inch)[0].sentence
    counted = replace(recording, time=recording.time * 100.0)
    assert found(counted)[0].kind == "time"
