"""Commands run as a user runs them, and what is asked of every refusal."""

import json
import os
import re
import shutil

import pytest
import tomlkit
from click.testing import CliRunner

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.cli.main import main
from mjsim.io.resources import examples

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs signals, links or a shell as POSIX has them")
#: A short campaign of two tests, of which the first is measured (fixture ``good``).
CAMPAIGN = """\
name = "short"
[instrument]
sample_rate_Hz = 100.0
[[test]]
name = "turn"
trace = "traces/turn.csv"
kind = "rotary"
axis = "A"
from_deg = 0.0
to_deg = 30.0
sensitive_direction = "tangential"
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 2000.0
[[test]]
name = "cone"
kind = "cone_frustum"
half_apex_deg = 15.0
inclination_deg = 10.0
sensitive_direction = "perpendicular"
direction = "CCW"
table_ball_mm = [0.0, 0.0, 155.0]
bar_length_mm = 100.0
feed_mm_min = 2000.0
"""
#: A file with an effect of a user's own; its ``kind`` is to be filled in.
OWN = """\
import numpy as np
import mjsim

@mjsim.register
class Mine(mjsim.Effect):
    kind = "{kind}"
    subjects = ("X", "Y")
    title = definition = source = signature = "test"
    parameters = (mjsim.Parameter("offset_um", "offset", -50.0, 50.0, neutral=0.0, scale=1.0),)

    def position_error(self, motion):
        out = np.zeros_like(motion.position)
        out[:, motion.column(self.subject)] = self.si("offset_um")
        return out
"""


def with_b_axis(text, configuration="w-C'B'Y'bXZ-t"):
    """A machine file of an example, with a B axis in the place of A."""
    for old, new in (("w-C'A'Y'bXZ-t", configuration), ("[drive.A]", "[drive.B]"), ("friction.A", "friction.B")):
        assert old in text
        text = text.replace(old, new)
    return text


#: Tests of the hidden-backlash example that show the backlash, and are quick.
TESTS = ("cone15-centre-ccw", "circle-xy-ccw", "rotary-a-tangential-ccw")


def run(*args):
    return CliRunner().invoke(main, [str(a) for a in args])


def ok(*args):
    """Run a command that must succeed."""
    result = run(*args)
    assert result.exit_code == 0, result.output
    return result


def printed(*args, code=0):
    """What a command prints that must end with this exit status: of one that fails, the refusal as well."""
    result = run(*args)
    assert result.exit_code == code, result.output
    return result.output if code else result.stdout


def read(folder):
    """The campaign and the machine of a folder."""
    campaign = read_campaign(folder)
    return campaign, read_machine(campaign.machine_file)


def as_json(*args):
    """Run a command with --json: one object on stdout, and with --quiet nothing on stderr."""
    result = ok(*args, "--json", "--quiet")
    assert result.stderr == ""

    def constant(name):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(result.stdout, parse_constant=constant)


def cut(target, tests=TESTS, traces=True, example="hidden-backlash"):
    """An example with some of its tests only."""
    source = examples() / example
    (target / "traces").mkdir(parents=True)
    document = tomlkit.parse((source / "campaign.toml").read_text())
    for i in reversed(range(len(document["test"]))):
        if document["test"][i]["name"] not in tests:
            del document["test"][i]
        elif not traces:
            del document["test"][i]["trace"]
    (target / "campaign.toml").write_text(tomlkit.dumps(document))
    for name in tests if traces else ():
        shutil.copy(source / "traces" / f"{name}.csv.gz", target / "traces")
    shutil.copy(source / "machine.toml", target)
    return target


def well_labelled(figure):
    """No legend lies on data, and units stand behind a comma."""
    figure.canvas.draw()
    for axes in figure.axes:
        legend = axes.get_legend()
        assert legend is None or legend.get_window_extent().y0 >= axes.get_window_extent().y1 - 1.0
        assert not re.search(r"[\[(]", axes.get_xlabel() + axes.get_ylabel())
    return True


def snapshot(folder):
    return {
        p.relative_to(folder): p.read_bytes() if p.is_file() else None
        for p in folder.rglob("*")
        if "__pycache__" not in p.parts
    }


def refused(folder, args, *words, status=1):
    """The command must refuse, in one sentence with all ``words`` in it, and leave every file as it is."""
    before = snapshot(folder)
    result = run(*args)
    assert result.exit_code == status, result.output
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    if status == 1:
        assert result.stderr.startswith("mjsim: ") and result.stderr.count("\n") == 1, result.stderr
        assert len(result.stderr) < 700
    for word in words:
        assert word in result.stderr, result.stderr
    assert snapshot(folder) == before
    return result.stderr
