"""A file format of one's own is one class: `mjsim import` reads its files by their suffix."""

import json
import shutil

import numpy as np
import pytest

import mjsim
from mjsim.errors import InputError
from mjsim.importing.formats import Format, base, register
from mjsim.importing.table import Table
from mjsim.io.inputs import read_bytes
from mjsim.io.resources import examples


@pytest.fixture
def format_json(monkeypatch):
    monkeypatch.setattr(base, "_FORMATS", dict(base._FORMATS))

    @register
    class JSON(Format):
        suffixes = (".json",)

        def read(self, path, options):
            try:
                data = json.loads(read_bytes(path))
            except ValueError as error:
                raise InputError(f"{path}: {error}; allowed: JSON with t_ms and r_um") from None
            values = np.column_stack([data["t_ms"], data["r_um"]])
            lines = np.arange(1, len(values) + 1)
            return Table(path, ("time", "deviation"), ("ms", "um"), values, lines, (), ("JSON",))

    return JSON


@pytest.mark.parametrize("ending", [".json", ".JSON"])
def test_a_trace_in_a_format_of_ones_own(tmp_path, format_json, ending):
    folder = shutil.copytree(examples() / "hidden-backlash", tmp_path / "c")
    before = mjsim.read_campaign(folder).traces["cone15-centre-ccw"]
    file = tmp_path / f"run{ending}"
    file.write_text(json.dumps({"t_ms": list(before.time * 1e3), "r_um": list(before.deviation * 1e6)}))
    result = mjsim.import_trace(folder, file, "cone15-centre-ccw", force=True, check=False)
    after = mjsim.read_campaign(folder).traces["cone15-centre-ccw"]
    assert "JSON" in result.notes and np.abs(after.deviation - before.deviation).max() < 1e-9
    assert np.abs(after.time - before.time).max() < 1e-6


def test_its_errors_are_sentences(tmp_path, format_json):
    file = tmp_path / "run.json"
    file.write_text("{")
    with pytest.raises(InputError, match=r"run\.json: .*allowed: JSON"):
        mjsim.import_trace(examples() / "hidden-backlash", file, "cone15-centre-ccw", preview=True)
