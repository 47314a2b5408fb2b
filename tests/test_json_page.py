"""The page on JSON names every key that the commands print."""

import re
from pathlib import Path

from commands import as_json

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "json.md").read_text(encoding="utf-8")


def documented(command):
    """Keys in the first column of a command's table."""
    table = PAGE.partition(f"\n## {command}\n")[2].partition("\n## ")[0]
    return {
        key for row in table.splitlines() if row.startswith("| `") for key in re.findall(r"`(\w+)`", row.split("|")[1])
    }


def test_every_key_of_the_commands_is_on_the_page(good, tmp_path):
    # keys that come with an option, with imported features or with other instruments only
    more = {
        "compare": {"rms_as_given_um", "calibration", "combinations", "shares", "budget", "nest"},
        "diagnose": {"imported", "r_tests", "sphere_tests", "position_tests", "signals", "encoders", "without_support"},
    }
    printed = {
        "compare": as_json("compare", good, "--no-plots", "--as-is"),
        "diagnose": as_json("diagnose", good, "--as-is"),
        "explain": as_json("explain", good, "backlash.A", "--no-plots", "--as-is"),
        "fleet": as_json("fleet", good, "--out", tmp_path, "--as-is", "--threads", "1"),
    }
    for command, data in printed.items():
        assert set(data) == documented(command) - more.get(command, set()), command
    rows = {"compare": ("tests",), "explain": ("tests",), "fleet": ("results",)}
    for command, names in rows.items():
        for name in names:
            for key in printed[command][name][0] if printed[command][name] else ():
                assert f"`{key}`" in PAGE, f"{command}: {name}: {key}"
