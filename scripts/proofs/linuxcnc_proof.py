"""What LinuxCNC makes of the programs of a campaign, and whether mjsim's model of it foretells that.

Every test is run twice: with steps of 0.1°, and with the steps that mjsim writes for LinuxCNC. Needs linuxcnc-uspace.

    scripts/proofs/linuxcnc_proof.py [CAMPAIGN] [--acceleration 5000] [--revolutions 1] [--test NAME ...]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from mjsim.campaign.files import read_campaign
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.io.resources import examples
from mjsim.linuxcnc.configuration import ACCELERATION, Settings
from mjsim.linuxcnc.record import held_against
from mjsim.linuxcnc.run import run_program
from mjsim.nc.write import Options, nc_program


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", nargs="?", type=Path, default=examples() / "hidden-backlash")
    parser.add_argument("--acceleration", type=float, default=ACCELERATION, help="of all axes, mm/s² and °/s²")
    parser.add_argument("--test", action="append")
    parser.add_argument("--revolutions", type=int, default=1)
    a = parser.parse_args()
    print(
        "| test | by F, s | step of 0.1°: LinuxCNC, s | mjsim's step: LinuxCNC, s | model, s | mean feed, mm/min | "
        "model | feed from to, mm/min | reading, µm | model, µm |\n|" + "---|" * 10
    )
    for test in read_campaign(a.campaign, traces=False).tests:
        if a.test and test.name not in a.test:
            continue
        test = replace(test, revolutions=a.revolutions) if kind_of(test).goes_round else test
        settings = Settings(dict.fromkeys(test.chain.letters, a.acceleration))
        plain = nc_program(test, Options(dialect="linuxcnc", whole_cycles=False))
        written = nc_program(test, Options(dialect="linuxcnc"))
        shortened = run_program(plain.text, test.chain, settings).duration
        held = held_against(test, written.motion, run_program(written.text, test.chain, settings), settings)
        real, model = held.record.to_json(), held.model.to_json()
        bars = [f"{d['reading_um']['min']:.3f} to {d['reading_um']['max']:.3f}" for d in (real, model)]
        print(
            f"| {test.name} | {held.by_f:.3f} | {shortened:.3f} | {held.lasted:.3f} | {held.model.duration:.3f} | "
            f"{real['mean_mm_min']:.1f} | {model['mean_mm_min']:.1f} | {real['min_mm_min']:.0f} to "
            f"{real['max_mm_min']:.0f} | {bars[0]} | {bars[1]} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
