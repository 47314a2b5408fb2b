"""What a fleet's diagnoses say as tables: campaigns, findings, calibrated numbers; in Parquet, units in the columns."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from mjsim.batch.arrow import pa, pq
from mjsim.batch.describe import versions
from mjsim.io.files import write_whole

_TEXT, _NUMBER, _WHOLE, _TRUTH = pa.string(), pa.float64(), pa.int64(), pa.bool_()
#: Columns that all tables begin with: type, unit, meaning.
_WHOSE = {
    "machine": (_TEXT, "", "name in machine.toml"),
    "configuration": (_TEXT, "", "of the axes"),
    "campaign": (_TEXT, "", "name in campaign.toml"),
    "date": (_TEXT, "", "day of measuring, ISO 8601; null where campaign.toml has none"),
    "folder": (_TEXT, "", "of the campaign"),
}
_SIZE = {
    "effect": (_TEXT, "", "key of the effect, such as backlash.A"),
    "number": (_TEXT, "", "which size of the effect: a parameter, or a wave such as order 60 (its amplitude)"),
    "unit": (_TEXT, "", "of value, low, high, expected and limit"),
    "value": (_NUMBER, "see unit", "estimate"),
    "low": (_NUMBER, "see unit", "lower end of its 95 % interval"),
    "high": (_NUMBER, "see unit", "upper end of its 95 % interval"),
    "expected": (_NUMBER, "see unit", "value in the machine file, or neutral; null without a tolerance"),
    "limit": (_NUMBER, "see unit", "tolerance; null without one"),
}
#: Table -> its columns.
TABLES: dict[str, dict[str, tuple]] = {
    "campaigns": {
        **_WHOSE,
        "tests": (_WHOLE, "", "measured tests"),
        "verdict": (_TEXT, "", "identified, ambiguous, unknown or nothing_found; null where the diagnosis failed"),
        "unexplained": (_TEXT, "", "what is left that no effect of the catalogue explains"),
        "noise_um": (_NUMBER, "µm", "RMS of the noise of one sample"),
        "rms_before_um": (_NUMBER, "µm", "RMS residual of the machine as given"),
        "rms_after_um": (_NUMBER, "µm", "RMS residual of the final model"),
        "seconds": (_NUMBER, "s", "time of the diagnosis"),
        "error": (_TEXT, "", "why there is no diagnosis; null where there is one"),
    },
    "findings": {
        **_WHOSE,
        **_SIZE,
        "share": (_NUMBER, "", "share of the whole effect in the explained squared error, 0 to 1"),
        "alternatives": (_TEXT, "", "effects that the tests cannot tell from it, with a comma between them"),
    },
    "calibration": {
        **_WHOSE,
        **_SIZE,
        "used_percent": (_NUMBER, "%", "departure from expected over limit"),
        "observable": (_TRUTH, "", "whether the tests say more about it than the tolerance does"),
        "rms_um": (_NUMBER, "µm", "RMS over all tests of what the effect changes once the set-up is fitted"),
    },
}


def rows_of(table: str, campaigns: Iterable[dict]) -> list[dict]:
    """Rows of one table from the results of the campaigns."""
    out = []
    for c in campaigns:
        whose = {name: c.get(name) for name in _WHOSE}
        if table == "campaigns":
            out.append({name: c.get(name) for name in TABLES[table]})
            continue
        for row in c.get(table, ()):
            row = {**whose, **row}
            if "alternatives" in row:
                row["alternatives"] = ", ".join(row["alternatives"])
            out.append({name: row.get(name) for name in TABLES[table]})
    return out


def write(folder: Path, campaigns: Sequence[dict]) -> list[Path]:
    """Write all tables as Parquet files into ``folder``; what each column means is inside."""
    files = []
    about = json.dumps({"versions": versions()})
    for name, columns in TABLES.items():
        fields = [
            pa.field(k, kind, metadata={"unit": unit, "meaning": meaning})
            for k, (kind, unit, meaning) in columns.items()
        ]
        schema = pa.schema(fields, metadata={"mjsim.fleet": about})
        buffer = io.BytesIO()
        pq.write_table(pa.Table.from_pylist(rows_of(name, campaigns), schema=schema), buffer, compression="zstd")
        files.append(folder / f"{name}.parquet")
        write_whole(files[-1], buffer.getvalue(), force=True)
    return files
