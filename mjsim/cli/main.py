"""The console command ``mjsim``; each subcommand is loaded when it is called."""

from __future__ import annotations

import os
from importlib import import_module

import click

from mjsim.simulation.cache import forget_stale_code
from mjsim.threads import share_one_heap

# numba's coloured error messages leave an escape sequence on the terminal at exit, whatever NO_COLOR says
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

_COMMANDS = {
    "demo": "The hidden-effect walk-through: watch the error fall.",
    "new": "Start a campaign: a folder with commented files.",
    "machine": "Machine file and MuJoCo model of any chain of axes.",
    "import": "Measurement files of other systems into a campaign.",
    "open": "The workbench: change the model, watch the error fall, live.",
    "simulate": "Run a campaign's tests in the multibody model.",
    "check": "Look for wrong units, signs, directions and feeds.",
    "compare": "Measured against simulated, test by test.",
    "export": "Compared traces and their figures as CSV.",
    "diagnose": "Which effects are missing.",
    "geometry": "Where the axes are: location errors and squareness, with intervals.",
    "explain": "One effect: its signature, what looks like it, why it was named.",
    "identify": "Pitch errors from turns of one axis; drives from axis logs.",
    "plan": "The next test that separates what cannot be told apart.",
    "compensate": "What to type into the control, and what it will bring.",
    "predict": "The error that a part will have.",
    "report": "One offline page: evidence, plots, repairs; or a trend.",
    "add": "Fit an effect and put it into the machine file.",
    "remove": "Take an effect out of the machine file.",
    "nc": "Write and read five-axis NC programs; the feed they really give.",
    "control": "A real control runs a test's program; what it tells the axes.",
    "history": "The ladder: every model tried and its error.",
    "animate": "A video of a test, or of the ladder.",
    "effects": "The catalogue of effects.",
    "figures": "The paper's figures 3 to 17, and its numbers beside simulated ones.",
    "fleet": "Diagnose many campaigns; tables, and the trend of each machine.",
    "batch": "Sweeps over effects and tests: grids, Latin hypercubes, tolerances.",
    "completion": "Completion of commands, effects and tests in the shell.",
}


class _Lazy(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        return import_module(f"mjsim.cli.{cmd_name}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.group(cls=_Lazy, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="mjsim", prog_name="mjsim")
def main() -> None:
    """Find out what is wrong with a machine tool from its measurements.

    Start with `mjsim demo`, then `mjsim compare FOLDER` and `mjsim diagnose FOLDER` on your own campaign.
    """
    share_one_heap()
    forget_stale_code()
