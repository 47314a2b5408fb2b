"""Files: written whole or not at all; a machine file survives editing with its comments, order and meaning."""

import os
import tomllib

import pytest
from commands import OWN, POSIX

from mjsim.campaign.machine_file import machine_document, read_machine, write_machine
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.io.files import check_writable, write_whole
from mjsim.io.resources import examples
from mjsim.machine.chain import FIVE_AXIS

MACHINE = (examples() / "hidden-backlash" / "machine.toml").read_text()


def names(folder):
    return sorted(p.name for p in folder.iterdir())


# -- write_whole -------------------------------------------------------------------------------------------------------


def test_text_and_bytes(tmp_path):
    write_whole(tmp_path / "new" / "a.txt", "µm\n")
    write_whole(tmp_path / "new" / "b.bin", b"\0\1")
    assert (tmp_path / "new" / "a.txt").read_bytes() == "µm\n".encode()
    assert (tmp_path / "new" / "b.bin").read_bytes() == b"\0\1"
    assert names(tmp_path / "new") == ["a.txt", "b.bin"]


def test_nothing_is_replaced_without_force(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("mine")
    with pytest.raises(InputError, match=r"a\.txt: exists already.*--force"):
        write_whole(file, "other")
    assert file.read_text() == "mine"
    write_whole(file, "other", force=True)
    assert file.read_text() == "other"


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["disk full", "stopped"]
)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, error):
    file = tmp_path / "a.txt"
    file.write_text("mine")

    def fail(*args):
        raise error

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InputError if isinstance(error, OSError) else KeyboardInterrupt):
        write_whole(file, "other", force=True)
    assert file.read_text() == "mine"
    assert names(tmp_path) == ["a.txt"]


@POSIX
def test_links_are_followed_and_permissions_kept(tmp_path):
    (tmp_path / "real.txt").write_text("mine")
    (tmp_path / "real.txt").chmod(0o640)
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    write_whole(tmp_path / "link.txt", "other", force=True)
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "other"
    assert (tmp_path / "real.txt").stat().st_mode & 0o777 == 0o640


def test_check_writable_says_the_same_before(tmp_path):
    (tmp_path / "a.txt").write_text("mine")
    check_writable(tmp_path / "new" / "deeper" / "b.txt")
    check_writable(tmp_path / "a.txt", force=True)
    for path in (tmp_path / "a.txt", tmp_path / "a.txt" / "b.txt"):
        with pytest.raises(InputError):
            check_writable(path)
        with pytest.raises(InputError):
            write_whole(path, "other")
    assert names(tmp_path) == ["a.txt"]


# -- machine files -----------------------------------------------------------------------------------------------------

COMMENTED = (
    "# machine no. 7, hall 3\n"
    + MACHINE.replace("[drive.A]", "# serviced in May\n[drive.A]", 1).replace(
        "worm_teeth = 60", "worm_teeth = 60   # counted", 1
    )
    + "\n# end of the list\n"
)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(COMMENTED)
    return path


def test_an_unchanged_machine_is_the_same_text(file):
    assert machine_document(read_machine(file), file) == COMMENTED


@pytest.mark.parametrize("effect_id", registry.all_ids())
def test_every_effect_survives_the_file(file, effect_id):
    cls, subject = registry.effect_class(effect_id)
    needed = {
        p.name: [[72.0, 0.001, 30.0], [180.0, 0.0005, -90.0]]
        if p.kind == "components"
        else p.lower + 0.3 * (min(p.upper, 10.0) - p.lower)
        for p in cls.parameters_of(subject)
        if p.kind not in ("choice", "sensor")
    } | {p.name: "spindle nose" for p in cls.parameters_of(subject) if p.kind == "sensor"}
    values = {**needed, **next(iter(cls.search.seeds_of(cls.parameters_of(subject), subject, FIVE_AXIS)), {})}
    machine = read_machine(file)
    effect = cls(subject, **values)
    changed = machine.with_effect(effect)
    write_machine(changed, file, file, force=True)
    again = read_machine(file)
    assert [e.key for e in again.effects] == [e.key for e in changed.effects]
    found = again.effect(effect.key).values
    assert found.keys() == effect.values.keys()
    for name, value in effect.values.items():
        assert found[name] == (pytest.approx(value, rel=1e-8) if isinstance(value, float) else value)
    for comment in ("# machine no. 7, hall 3", "# serviced in May", "# counted", "# end of the list"):
        assert comment in file.read_text()


def test_taking_an_effect_out_restores_the_meaning(file):
    machine = read_machine(file)
    write_machine(machine.with_effect(registry.make("backlash.A", width_deg=0.002)), file, file, force=True)
    assert tomllib.loads(file.read_text())["effect"][-1] == {"id": "backlash.A", "width_deg": 0.002}
    assert '\n\n[[effect]]\nid = "backlash.A"' in file.read_text()
    write_machine(read_machine(file).without("backlash.A"), file, file, force=True)
    assert tomllib.loads(file.read_text()) == tomllib.loads(COMMENTED)


def test_changed_numbers_are_the_only_changed_lines(file):
    machine = read_machine(file)
    friction = machine.effect("friction.Y")
    changed = machine.with_drive("A", position_gain=46.5).with_effect(friction.replaced(coulomb_Nm=1.5))
    lines = machine_document(changed, file).splitlines()
    before = COMMENTED.splitlines()
    assert len(lines) == len(before)
    different = [(a, b) for a, b in zip(before, lines, strict=True) if a != b]
    assert different == [
        ("position_gain_per_s = 45.0", "position_gain_per_s = 46.5"),
        ("coulomb_Nm = 1.2", "coulomb_Nm = 1.5"),
    ]


HEAD = MACHINE[: MACHINE.index("[[effect]]")]


@pytest.mark.parametrize(
    "text",
    [
        HEAD,
        HEAD + "\n# no effects yet\n",
        "effect = []\n" + HEAD,
        'effect = [{id = "friction.X", coulomb_Nm = 1.0, presliding_rad = 0.003}]\n' + HEAD,
        MACHINE.replace("\n", "\r\n"),
    ],
    ids=["no effect", "comment at the end", "empty list", "inline table", "Windows line ends"],
)
def test_first_effect_of_other_layouts(file, text):
    file.write_bytes(text.encode())
    machine = read_machine(file)
    changed = machine.with_effect(registry.make("backlash.A", width_deg=0.002))
    write_machine(changed, file, file, force=True)
    assert [e.key for e in read_machine(file).effects] == [e.key for e in changed.effects]
    lines = file.read_bytes().split(b"\n")[:-1]
    assert all(row.endswith(b"\r") == ("\r\n" in text) for row in lines)
    write_machine(read_machine(file).without("backlash.A"), file, file, force=True)
    assert [e.key for e in read_machine(file).effects] == [e.key for e in machine.effects]


def test_both_directions_of_a_pitch_error_are_two_entries(file):
    machine = read_machine(file)
    for direction, amplitude in (("CW", 0.001), ("CCW", 0.002)):
        machine = machine.with_effect(
            registry.make("pitch_error.C", components=[[72.0, amplitude, 0.0]], direction=direction)
        )
    write_machine(machine, file, file, force=True)
    again = read_machine(file)
    assert [e.key for e in again.effects[-2:]] == ["pitch_error.C[CW]", "pitch_error.C[CCW]"]
    write_machine(again.without("pitch_error.C[CW]"), file, file, force=True)
    assert [e.values["direction"] for e in read_machine(file).effects if e.id == "pitch_error.C"] == ["CCW"]


def test_an_effect_file_is_found_beside_the_machine_and_from_elsewhere(file, tmp_path):
    (tmp_path / "mine.py").write_text(OWN.format(kind="mine_of_files"))
    file.write_text(COMMENTED + '\n[[effect]]\nid = "mine_of_files.X"\nfile = "mine.py"\noffset_um = 1.5\n')
    machine = read_machine(file)
    assert machine.effects[-1].values == {"offset_um": 1.5}
    elsewhere = tmp_path / "elsewhere" / "fitted.toml"
    write_machine(machine, file, elsewhere)
    assert read_machine(elsewhere).effects[-1].id == "mine_of_files.X"
    write_machine(machine, file, tmp_path / "beside.toml")
    assert tomllib.loads((tmp_path / "beside.toml").read_text())["effect"][-1]["file"] == "mine.py"
    assert not (tmp_path / "__pycache__").exists()


def test_an_edited_effect_file_is_read_again(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN.format(kind="mine_edited"))
    assert registry.load_file(path).subjects == ("X", "Y")
    path.write_text(OWN.format(kind="mine_edited").replace('("X", "Y")', '("X", "Z")'))
    assert registry.load_file(path).subjects == ("X", "Z")
    assert registry.kinds()["mine_edited"].subjects == ("X", "Z")


def test_a_file_that_fails_leaves_the_catalogue_alone(tmp_path):
    before = registry.kinds()
    path = tmp_path / "mine.py"
    path.write_text(OWN.format(kind="mine_broken") + "\n1 / 0\n")
    with pytest.raises(InputError, match=r"mine\.py raised ZeroDivisionError.*\(mine\.py, line"):
        registry.load_file(path)
    assert registry.kinds() == before


def test_a_stretch_may_be_missing_at_the_end_of_a_trace(tmp_path):
    """Up to a few seconds of a trace that lies inside its program: a gap, not another feed."""
    import gzip
    import shutil

    from mjsim.campaign.files import read_campaign
    from mjsim.instruments.ball_bar.files import LARGEST_GAP

    folder = shutil.copytree(examples() / "hidden-backlash", tmp_path / "campaign")
    path = folder / "traces" / "circle-xy-ccw.csv.gz"
    rows = gzip.decompress(path.read_bytes()).splitlines(keepends=True)
    for seconds, accepted in ((LARGEST_GAP - 0.5, True), (LARGEST_GAP + 3.0, False)):
        path.write_bytes(gzip.compress(b"".join(rows[: -round(200 * seconds)])))
        if accepted:
            assert len(read_campaign(folder).traces["circle-xy-ccw"].time) == len(rows) - 1 - round(200 * seconds)
        else:
            with pytest.raises(InputError, match="time_s runs from"):
                read_campaign(folder)
