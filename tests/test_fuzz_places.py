"""What stands where a file is expected, files that are too large, paths that lead elsewhere, hostile XML and TOML: one sentence, soon."""

import gzip
import shutil
import tomllib

import click
import numpy as np
import pytest
from commands import CAMPAIGN, ok, refused, run, snapshot
from fuzzing import TALLY, odd_places, patience, sentence

import mjsim
from mjsim.ballbar.measurement import Instrument
from mjsim.batch.dataset import Folder
from mjsim.batch.sweep import read_sweep
from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.traces import MOST, read_trace
from mjsim.cli.main import main
from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.importing.b5r import read_b5r
from mjsim.importing.table import read_table
from mjsim.io.files import check_writable, write_whole
from mjsim.io.resources import model_file, scene_file
from mjsim.nc.read import read_nc


@pytest.fixture
def campaign(good, tmp_path):
    return shutil.copytree(good, tmp_path / "short")


# -- what is no file ---------------------------------------------------------------------------------------------------------------

READERS = {
    "campaign.toml": read_campaign,
    "machine.toml": read_machine,
    "trace": lambda p: read_trace(p, Instrument()),
    "table": read_table,
    ".b5r": read_b5r,
    "NC program": read_nc,
    "sweep": read_sweep,
    "effect file": lambda p: registry.load_file(p.with_suffix(".py") if len(p.name) < 255 else p),
}


_THERE = {"a folder", "a link to itself", "a link to nothing", "a FIFO", "an endless device"}


@pytest.mark.parametrize("reader", READERS)
def test_no_reader_waits_for_a_pipe_or_breaks_on_a_folder(reader, tmp_path):
    places = odd_places(tmp_path)
    if reader == "effect file":
        places = {k: p.rename(p.with_suffix(".py")) if k in _THERE else p for k, p in places.items()}
    for place, path in places.items():
        with patience(10), pytest.raises(InputError) as caught:
            READERS[reader](path)
        if "too long" not in place:
            sentence(caught.value, path.stem)
        TALLY[f"{reader} in an odd place", "refused"] += 1


@pytest.mark.parametrize("key", ["trace", "machine", "program"])
def test_a_campaign_names_what_is_no_file(campaign, key):
    places = odd_places(campaign)
    for path in places.values():
        name = path.relative_to(campaign)
        line = f'{key} = "{name}"\n'
        text = {
            "trace": CAMPAIGN.replace('trace = "traces/turn.csv"\n', line),
            "machine": CAMPAIGN.replace("[instrument]", line + "[instrument]"),
            "program": CAMPAIGN.replace('axis = "A"\n', 'axis = "A"\n' + line),
        }[key]
        (campaign / "campaign.toml").write_text(text)
        with patience(20):
            result = run("compare", campaign, "--no-plots", "--json")
        assert result.exit_code == 1 and result.stderr.startswith("mjsim: ") and result.stdout == "", (
            path,
            result.output,
            result.exception,
        )
        assert result.stderr.count("\n") == 1 and len(result.stderr) < 700


def test_what_mjsim_keeps_may_be_no_file_either(campaign):
    """A pipe or a folder in the place of the history, of imported features, of a data set's description."""
    places = odd_places(campaign.parent / "odd") if (campaign.parent / "odd").mkdir() is None else {}
    for kind in ("a FIFO", "a folder", "a link to itself", "an endless device"):
        for keep, words in ((".mjsim/history.json", ["history", campaign]), ("imported/a.json", ["compare", campaign, "--no-plots"])):
            (campaign / keep).parent.mkdir(exist_ok=True)
            (campaign / keep).symlink_to(places[kind])
            with patience(10):
                result = run(*words, "--json")
            assert result.exit_code == 1 and result.stderr.startswith("mjsim: "), (kind, keep, result.output, result.exception)
            assert result.stdout == ""
            (campaign / keep).unlink()


def test_a_data_set_with_files_of_others(campaign, tmp_path):
    sweep = tmp_path / "sweep.toml"
    sweep.write_text(
        'name = "w"\ncampaign = "short"\ntests = ["turn"]\n[[vary]]\nparameter = "backlash.A.width_deg"\nvalues = [0.0, 0.001]\n'
    )
    out = tmp_path / "out"
    ok("batch", sweep, "--out", out, "--quiet")
    import pyarrow as pa
    import pyarrow.parquet as pq

    part = out / "results" / "part-00001.parquet"
    whole = out / "results" / "part-00000.parquet"
    strange = {
        "other columns": pa.table({"a": [1]}),
        "other tests": pa.table({"run": [0], "test": ["nobody"]}),
        "other runs": pa.table({"run": [77], "test": ["turn"]}),
        "texts for runs": pa.table({"run": ["x"], "test": ["turn"]}),
    }
    for table in strange.values():
        pq.write_table(table, part)
        refused(tmp_path, ["batch", sweep, "--out", out, "--json"], part.name, "no file of this sweep")
    part.unlink()
    (out / "results" / "part-sabc.parquet").write_bytes(whole.read_bytes())
    refused(tmp_path, ["batch", sweep, "--out", out, "--json"], "part-sabc.parquet", "no file of this sweep")
    (out / "results" / "part-sabc.parquet").unlink()
    part.mkdir()
    refused(tmp_path, ["batch", sweep, "--out", out, "--json"], part.name)
    part.rmdir()
    (out / "sweep.json").write_text("[" * 100_000)
    refused(tmp_path, ["batch", sweep, "--out", out, "--json"], "sweep.json", "no description")
    assert Folder.check(read_sweep(sweep), out, force=True) is None


# -- output ------------------------------------------------------------------------------------------------------------------------


def test_only_regular_files_are_replaced(tmp_path):
    """Not even with --force: as root that would take /dev/null away."""
    places = odd_places(tmp_path)
    before = snapshot(tmp_path)
    for kind in ("a folder", "a link to itself", "a FIFO", "below a file", "an endless device", "a name too long", "a path too long"):
        for check in (check_writable, lambda p, f: write_whole(p, "x", f)):
            with pytest.raises(InputError) as caught:
                check(places[kind], True)
            assert len(str(caught.value)) < 690
    assert snapshot(tmp_path) == before
    assert places["a FIFO"].is_fifo()


def test_folders_without_end(tmp_path):
    """A thousand folders in one another fit into a path, and not into the recursion that makes them."""
    deep = tmp_path / ("d/" * 1500)
    for line in (["new", "campaign", deep], ["demo", "--out", deep]):
        refused(tmp_path, line, "folders in one another")
    with pytest.raises(InputError, match="folders in one another"):
        write_whole(deep / "x", "x")


def test_long_names_that_can_be_written_are(tmp_path):
    name = "n" * 240 + ".txt"
    write_whole(tmp_path / name, "x")
    write_whole(tmp_path / name, "y", force=True)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(name, "y")]


# -- files that are too large ------------------------------------------------------------------------------------------------------

LARGE = {
    "campaign.toml": ("5 MB", read_campaign), "machine.toml": ("5 MB", read_machine), "sweep.toml": ("5 MB", read_sweep),
    "t.csv": ("thin the trace", lambda p: read_trace(p, Instrument())), "t.txt": ("thin the trace", read_table),
    "p.nc": ("20 MB", read_nc), "r.b5r": ("10 MB", read_b5r),
}  # fmt: skip


@pytest.mark.parametrize("name", LARGE)
def test_a_terabyte(tmp_path, name):
    """Its size is enough to refuse it: nothing of it is read (the file is sparse)."""
    allowed, read = LARGE[name]
    with open(tmp_path / name, "wb") as file:
        file.truncate(10**12)
    with patience(5), pytest.raises(InputError, match=allowed) as caught:
        read(tmp_path / name)
    sentence(caught.value, name)
    assert "1000000 MB" in str(caught.value)


def test_too_many_rows(tmp_path):
    """50 million rows have 400 MB and more: too large. What is smaller, and has more rows than a ball bar makes, is counted first."""
    path = tmp_path / "t.csv"
    path.write_bytes(b"time_s,deviation_um\n" + b"1,0\n" * (MOST + 1))
    for read in (lambda p: read_trace(p, Instrument()), read_table):
        with patience(10), pytest.raises(InputError, match=f"{MOST + 1} rows|{MOST + 2} rows") as caught:
            read(path)
        assert "keep one row in 2" in sentence(caught.value, "t.csv")


def test_a_gzip_bomb(tmp_path):
    path = tmp_path / "t.csv.gz"
    path.write_bytes(gzip.compress(b"\0" * 1_000_000, 9) * 250)
    assert path.stat().st_size < 500_000
    with patience(20), pytest.raises(InputError, match="unpacks to more than 200 MB"):
        read_trace(path, Instrument())


# -- paths that lead elsewhere -----------------------------------------------------------------------------------------------------

OUTSIDE = ["../x.csv", "traces/../../x.csv", "/etc/passwd", "out/x.csv", "~/x.csv", "", " ", ".", "a\\u0000b", "a\\nb"]


@pytest.mark.parametrize("key", ["trace", "program"])
@pytest.mark.parametrize("name", OUTSIDE)
def test_paths_stay_in_the_folder(campaign, key, name):
    (campaign.parent / "x.csv").write_text("secret")
    (campaign / "out").symlink_to(campaign.parent)
    line = f'{key} = "{name}"\n'
    text = CAMPAIGN.replace('trace = "traces/turn.csv"\n', line if key == "trace" else line + 'trace = "traces/turn.csv"\n')
    (campaign / "campaign.toml").write_text(text)
    assert "secret" not in refused(campaign.parent, ["compare", campaign, "--json"], "short")


@pytest.mark.parametrize("key", ["campaign", "machine"])
@pytest.mark.parametrize("name", ["/etc/passwd", "/work", "", " ", "a\\nb", "a\\u0000b"])
def test_paths_of_a_sweep_are_relative(campaign, key, name):
    other = "" if key == "campaign" else 'campaign = "short"\n'
    sweep = campaign.parent / "sweep.toml"
    sweep.write_text(f'name = "w"\n{other}{key} = "{name}"\n[[vary]]\nparameter = "backlash.A.width_deg"\nvalues = [0.0]\n')
    refused(campaign.parent, ["batch", sweep, "--dry-run", "--json"], "sweep.toml", key)


@pytest.mark.parametrize("file", ["campaign.toml", "machine.toml", "mine.py"])
def test_an_import_does_not_replace_what_is_no_trace(campaign, file):
    (campaign / "mine.py").write_text("mine")
    (campaign / "campaign.toml").write_text(CAMPAIGN.replace("traces/turn.csv", file))
    refused(
        campaign.parent,
        ["import", campaign / "traces" / "turn.csv", "--campaign", campaign, "--test", "turn", "--force", "--json"],
        file,
        "no trace's file",
    )


def test_no_command_takes_a_model_of_the_users():
    """MJCF with includes and assets from anywhere is never read: the model is the one that is installed, which brings its own alone."""

    def options(command):
        if isinstance(command, click.Group):
            context = click.Context(command)
            return [o for n in command.list_commands(context) for o in options(command.get_command(context, n))]
        return [o for p in command.params for o in (*p.opts, *p.secondary_opts)]

    assert not {"--model", "--mjcf", "--xml"} & set(options(main))
    import defusedxml.ElementTree

    machine, scene = (defusedxml.ElementTree.parse(file, forbid_dtd=True).getroot() for file in (model_file(), scene_file()))
    assert not list(machine.iter("include"))
    assert [include.get("file") for include in scene.iter("include")] == [model_file().name]
    for element in (*machine.iter(), *scene.iter()):
        for key in ("file", "meshdir", "texturedir", "assetdir"):
            if name := element.get(key):
                assert (model_file().parent / name).resolve().is_relative_to(model_file().parent), name


# -- hostile TOML and XML ----------------------------------------------------------------------------------------------------------

NESTED = {
    "lists": "x = " + "[" * 100_000 + "]" * 100_000,
    "tables": "x = " + "{a = " * 50_000 + "1" + "}" * 50_000,
    "dotted key": "x" + ".a" * 500_000 + " = 1",
    "quoted dotted key": "x" + '."a b"' * 200_000 + " = 1",
    "header": "[x" + " . a" * 200_000 + "]\n",
    "list of tables": "[[x" + ".a" * 200_000 + "]]\n",
    "many headers": "".join(f"[x{'.a' * 30}.b{i}]\n" for i in range(2000)),
    "an endless word": "x" * 4_000_000,
    "an endless line of quotes": '"' * 2_000_000,
    "an endless number": "x = " + "1" * 4_000_000,
    "an endless float": "x = 0." + "1" * 4_000_000,
    "an endless text": 'x = "' + "a" * 4_000_000 + '"',
    "dots": "." * 4_000_000,
}


@pytest.mark.parametrize("name", NESTED)
def test_hostile_toml(tmp_path, name):
    path = tmp_path / "machine.toml"
    path.write_text(NESTED[name])
    with patience(20), pytest.raises(InputError) as caught:
        read_machine(path)
    sentence(caught.value, "machine.toml")


def test_keys_of_ordinary_files_are_no_deep_ones(tmp_path):
    """Dots in numbers, texts and comments do not count."""
    from mjsim.io.toml import parse

    path = tmp_path / "a.toml"
    numbers = "[" + ", ".join(["1.5"] * 500) + "]"
    text = f'a.b.c = {numbers}\n# {"a.b." * 5} and so on ..... \nd = "{"x. " * 200}"\ne = 1979-05-27T07:32:00.999Z\n'
    path.write_text(text)
    assert parse(path) == tomllib.loads(text)


BOMB = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10 if i else "&a;" * 10}">' for i in range(9))
XML = {
    "billion laughs": BOMB + ']><TEST_DOCUMENT><FEATURE NAME="x" DT="y">&a8;</FEATURE></TEST_DOCUMENT>',
    "quadratic blowup": f'<!DOCTYPE a [<!ENTITY a "{"a" * 100_000}">]><a>{"&a;" * 10_000}</a>',
    "external entity": '<!DOCTYPE a [<!ENTITY a SYSTEM "file:///etc/passwd">]><a><FEATURE NAME="x" DT="y">&a;</FEATURE></a>',
    "external DTD": '<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd"><a/>',
    "parameter entity": '<!DOCTYPE a [<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;]><a/>',
    "nested deeply": "<a>" * 100_000 + "</a>" * 100_000,
    "nested deeply and cut": "<a>" * 100_000,
    "attributes": "<a " + " ".join(f'b{i}="1"' for i in range(100_000)) + "/>",
    "unknown encoding": '<?xml version="1.0" encoding="utf-7"?><a/>',
    "include": '<a xmlns:xi="http://www.w3.org/2001/XInclude"><xi:include href="/etc/passwd" parse="text"/></a>',
}


@pytest.mark.parametrize("name", XML)
def test_hostile_xml(campaign, name):
    path = campaign.parent / "run.b5r"
    path.write_text(XML[name])
    with patience(20):
        assert "root:" not in refused(campaign.parent, ["import", path, "--campaign", campaign, "--json"], "run.b5r")


# -- searches that took for ever ---------------------------------------------------------------------------------------------------


def test_lines_that_could_be_read_in_many_ways(campaign):
    """Headers and blocks for which a search tried every way of dividing a row of blanks, digits or brackets."""
    rows = (campaign / "traces" / "turn.csv").read_text().partition("\n")[2]
    source = campaign.parent / "turn.txt"
    heads = ("a" + " " * 50_000 + "b", "1" * 100_000 + "x", "(" * 100_000, "[" * 50_000 + " " * 50_000, "/" * 100_000, "a_" * 50_000 + " ")
    for head in heads:
        for names in ("time_s,deviation_um", f"time_s,deviation_um{head.replace(',', '')}"):
            source.write_text(f"{head}\n{names}\n{rows}")
            with patience(20):
                result = run("import", source, "--campaign", campaign, "--preview", "--deviation-unit", "um", "--time", "1", "--json")
            assert result.exit_code in (0, 1) and isinstance(result.exception, SystemExit | None), (head[:20], result.exception)
    for block in ("X" + "1" * 100_000 + "..", "FGROUP(" * 50_000, "A = DC(" * 50_000, "(" * 100_000, "X1 " * 50_000, "N" + " " * 100_000):
        source.write_text(f"G90 G94 G1 F100.\n{block}\n")
        for dialect in ("fanuc", "siemens"):
            with patience(20), pytest.raises(InputError, match="line 2"):
                read_nc(source, dialect)


def test_a_message_never_grows(campaign):
    assert len(str(InputError("a" * 10**6))) < 690
    assert "\n" not in str(InputError("a\nb\x1b[31m"))
    with pytest.raises(mjsim.InputError) as caught:
        read_campaign("x" * 100_000)
    sentence(caught.value, "xxx")


def test_rates_that_no_recorder_has(campaign):
    """Most samples within a billionth of a second: the even clock that they would need does not fit into memory."""
    trace = campaign / "traces" / "turn.csv"
    lines = trace.read_text().split("\n")
    first = float(lines[1].split(",")[0])
    close = [f"{first + 1e-9 * i:.12f},0.0" for i in range(1, 400)]
    trace.write_text("\n".join([*lines[:2], *close, *lines[2:]]))
    refused(campaign.parent, ["compare", campaign, "--json"], "turn.csv", "even rate")


def test_lines_are_counted_with_blank_ones(campaign):
    trace = campaign / "traces" / "turn.csv"
    lines = trace.read_text().split("\n")
    trace.write_text("\n".join([*lines[:3], "", "", *lines[3:20], lines[5], *lines[20:]]))
    refused(campaign.parent, ["compare", campaign, "--json"], "turn.csv, line 23", "grow")
    assert np.isfinite(float(lines[5].split(",")[0]))
