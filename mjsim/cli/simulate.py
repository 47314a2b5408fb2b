"""``mjsim simulate``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("simulate")
@common.campaign_argument
@common.machine_option
@common.names_option
@common.folder_option("--out", required=True, help="Folder for the traces and plots.")
@click.option("--no-plots", is_flag=True, help="Only the CSV files.")
@click.option("--force", is_flag=True, help="Replace files that exist.")
@common.threads_option
@common.options
def command(campaign, machine, names, out, no_plots, force, threads) -> None:
    """Run the tests of CAMPAIGN in the multibody model. Needs no traces.

    Writes <test>.csv (time_s, phi_deg, deviation_um, commanded and actual axis positions) and a polar plot per test.

    \b
    Example: mjsim simulate examples/hidden-backlash --out simulated
    """
    from mjsim.errors import InputError
    from mjsim.instruments.ball_bar.program import range_warning, speed_warnings
    from mjsim.io.files import check_writable, together
    from mjsim.plots.output import polar_of_simulation, simulation_csv, simulation_summary
    from mjsim.plots.save import encode
    from mjsim.progress import counted
    from mjsim.simulation.multibody import simulate

    c, m = common.campaign_and_machine(campaign, machine, traces=False)
    c = c.in_motion
    if not c.tests:
        raise InputError(
            f"{c.folder / 'campaign.toml'}: no test in motion, so nothing to simulate; `mjsim compare {campaign}` lays "
            "the model beside what is measured at rest"
        )
    known = list(dict.fromkeys(n for t in c.tests for n in (t.name, t.recording)))
    for name in names:
        if name not in known:
            raise InputError(f"{c.folder / 'campaign.toml'}: no test {name!r}; it has: {', '.join(known)}")
    tests = [t for t in c.tests if not names or t.name in names or t.recording in names]
    targets = [out / f"{t.name}.csv" for t in tests] + ([] if no_plots else [out / f"{t.name}.png" for t in tests])
    for file in targets:
        check_writable(file, force)
    with common.progress_bar() as progress:
        progress("simulating", 0, len(tests))
        results = simulate(m, tests, common.cores(threads), counted(progress, "simulating", len(tests)))
        with together(force) as write:
            for i, s in enumerate(results):
                progress("writing", i, len(results))
                write(out / f"{s.test.name}.csv", simulation_csv(s))
                if not no_plots:
                    write(out / f"{s.test.name}.png", encode(polar_of_simulation(s), "png"))
    summary = simulation_summary(results)
    warnings = [
        w
        for s in results
        for w in (*speed_warnings(s.test), range_warning(s.test, s.deviation, c.instruments[s.test.instrument].range))
        if w
    ]
    if common.answered(
        {"campaign": c.name, "machine": m.name, "out": str(out), "tests": summary, "warnings": warnings}
    ):
        return
    common.table(
        ["test", "duration s", "G µm", "max µm", "min µm"],
        [
            [
                r["name"],
                f"{r['duration_s']:.1f}",
                f"{r['circular_error_um']:.2f}" if "circular_error_um" in r else "–",
                f"{r['max_um']:.2f}",
                f"{r['min_um']:.2f}",
            ]
            for r in summary
        ],
    )
    for warning in warnings:
        common.say(f"warning: {warning}")
    common.say(f"written to {out}")
