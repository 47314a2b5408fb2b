"""Compile once what every command needs, so that no user waits for it: Python's bytecode and Numba's machine code.

`scripts/setup` runs this at its end. Packages are installed without bytecode, of which the commands need a tenth; importing what they
import writes that tenth, some 40 MB, also where PYTHONDONTWRITEBYTECODE keeps the commands themselves from it.
"""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import re
import shutil
import sys
import tempfile
from pathlib import Path

sys.dont_write_bytecode = False

TESTS = ("cone15-centre-ccw", "rotary-a-tangential-ccw")
#: What functions import when they are called.
LATE = ("matplotlib.backends.backend_agg", "matplotlib.backends.backend_svg", "pandas", "rich.progress", "scipy.optimize")


def main() -> None:
    import mjsim
    from mjsim.cli.main import main as command
    from mjsim.io.resources import examples

    with tempfile.TemporaryDirectory() as folder:
        campaign = Path(folder) / "campaign"
        shutil.copytree(examples() / "hidden-backlash", campaign)
        head, *tests = re.split(r"(?m)^(?=\[\[test\]\])", (campaign / "campaign.toml").read_text(encoding="utf-8"))
        short = "".join(t for t in tests if any(f'name = "{name}"' in t for name in TESTS))
        (campaign / "campaign.toml").write_text(head + short, encoding="utf-8")
        for args in (["compare", str(campaign)], ["diagnose", str(campaign), "--max-effects", "1"], ["effects"]):
            command([*args, "--quiet"], standalone_mode=False)
    # what no command of these has loaded; some of it needs libraries that this machine may lack
    for name in (*LATE, *(m.name for m in pkgutil.walk_packages(mjsim.__path__, "mjsim."))):
        with contextlib.suppress(Exception):
            importlib.import_module(name)


if __name__ == "__main__":
    main()
