"""Writes the folder of the five-axis machine's model, or compares one: ``python -m mjsim.machine.modelling``.

The solids (``assets/*.stl``) are made from their dimensions. ``five_axis.xml`` and ``scene.xml`` are not made: they are
text that ships with the package, and are copied.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mjsim.io import resources
from mjsim.machine.modelling import five_axis
from mjsim.machine.modelling.folder import differences, write_folder


def main() -> int:
    """Run the command.

    Returns:
        Exit status: 1 where ``--check`` finds a difference.
    """
    parser = argparse.ArgumentParser(prog="python -m mjsim.machine.modelling", description=__doc__)
    shipped = resources.model_file().parent
    parser.add_argument("folder", nargs="?", type=Path, default=shipped, help="of the model (default: the shipped one)")
    parser.add_argument("--check", action="store_true", help="compare the folder instead of writing it")
    arguments = parser.parse_args()
    machine = five_axis.machine()
    if not arguments.check:
        write_folder(machine, arguments.folder)
        return 0
    wrong = differences(machine, arguments.folder)
    if wrong:
        print(f"{arguments.folder}: not as this program writes it: {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
