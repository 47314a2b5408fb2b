"""Picture and table of docs/real-worms.md from guide logs: docs/images/real-worms.png; prints the table.

Run it with the project's Python: ``.venv/bin/python scripts/build_real_worms.py LOG=NAME=TEETH …``. The logs are no
part of the project; the page says which they are.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from mjsim.campaign.files import read_campaign
from mjsim.campaign.new_machine import new_log_campaign
from mjsim.estimation.pitch.encoders import EncoderPitch, identify_from_encoders
from mjsim.importing.logs import import_log
from mjsim.plots.encoders import encoders_figure
from mjsim.plots.save import save
from mjsim.units import DEG

IMAGE = Path(__file__).resolve().parent.parent / "docs" / "images" / "real-worms.png"


def identified(log: Path) -> EncoderPitch:
    """What one guide log shows."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "mount"
        new_log_campaign(folder, "C")
        import_log(folder, log)
        return identify_from_encoders(read_campaign(folder), "C")


def main(arguments: list[str]) -> None:
    """Write the picture and print the table."""
    results = []
    print(
        "| mount | arc | turns | lowest order (95 %) | period | teeth | off | amplitude | other orders (amplitude ″) |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|--:|---|")
    for argument in arguments:
        path, name, teeth = argument.split("=")
        r = identified(Path(path))
        assert r.worm is not None
        order, sd = r.worm
        size = max((w.amplitude for w in r.waves if abs(w.order - order) < 0.05 * order), default=0.0)
        others = [w for w in r.waves if abs(w.order - order) >= 0.05 * order]
        listed = ", ".join(f"{w.order:.0f} ({3600 * w.amplitude / DEG:.1f})" for w in others)
        print(
            f"| {name} | {r.arc / DEG:.1f}° | {order * r.arc / (2 * np.pi):.1f} | {order:.2f} ± {1.96 * sd:.2f} | "
            f"{2 * np.pi / order / r.rate:.1f} s | {teeth} | {100 * (order / float(teeth) - 1):+.2f} % | "
            f"{3600 * size / DEG:.1f}″ | {listed} |"
        )
        results.append((f"{name}: order {order:.1f}", r))
    save(encoders_figure(results, "Worm gears of four telescope mounts, from their guide logs"), IMAGE)


if __name__ == "__main__":
    main(sys.argv[1:])
