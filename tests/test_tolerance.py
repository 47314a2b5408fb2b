"""The [tolerance] table of a machine file: read as it is, refused in one sentence where it makes no sense."""

import pytest

import mjsim
from mjsim.io.resources import examples

MACHINE = (examples() / "healthy" / "machine.toml").read_text(encoding="utf-8")


def read(tmp_path, lines):
    head, drives = MACHINE.split("[drive.", 1)
    file = tmp_path / "machine.toml"
    file.write_text(f"{head}[tolerance]\n{lines}\n\n[drive.{drives}", encoding="utf-8")
    return mjsim.read_machine(file)


def test_limits_are_read(tmp_path):
    machine = read(tmp_path, "axis_location = { um = 12.0, urad = 30.0 }\nfriction = { ratio = 0.4 }")
    assert machine.tolerance == {"axis_location": {"um": 12.0, "urad": 30.0}, "friction": {"ratio": 0.4}}


def test_a_machine_without_the_table_expects_nothing(tmp_path):
    file = tmp_path / "machine.toml"
    file.write_text(MACHINE, encoding="utf-8")
    assert mjsim.read_machine(file).tolerance == {}


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("play = { um = 1.0 }", r"\[tolerance\] play is no kind of effect; allowed: angular_error, axial"),
        ("squareness = { um = 1.0 }", r"\[tolerance\] squareness: unit 'um'; allowed: urad"),
        ("worm_wear = { deg = 0.1 }", r"worm_wear: this kind has no single size"),
        ("squareness = {}", r"squareness has no limit"),
        ("squareness = { urad = 0.0 }", "greater than 0|above 0"),
        ("squareness = 12.0", "tolerance"),
        ("backlash = { ratio = 0.4 }", "unit 'ratio'; allowed: um, deg"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(tmp_path, lines, said):
    with pytest.raises(mjsim.InputError, match=said) as error:
        read(tmp_path, lines)
    assert "\n" not in str(error.value) and "machine.toml" in str(error.value)


def test_writing_a_machine_keeps_the_table(tmp_path):
    machine = read(tmp_path, "squareness = { urad = 24.0 } # of the acceptance test")
    mjsim.write_machine(machine.with_drive("X", position_gain=44.0), machine.file, tmp_path / "new.toml")
    assert "squareness = { urad = 24.0 } # of the acceptance test" in (tmp_path / "new.toml").read_text(
        encoding="utf-8"
    )
    assert mjsim.read_machine(tmp_path / "new.toml").tolerance == machine.tolerance
