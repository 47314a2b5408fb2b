"""``mjsim completion``."""

from __future__ import annotations

import click

from mjsim.cli import common


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@common.options
def command(shell) -> None:
    """Print the script that completes mjsim's commands, options, effects and tests in SHELL.

    \b
    Example: mjsim completion bash
    One line makes it last:
      bash  eval "$(mjsim completion bash)"   in ~/.bashrc
      zsh   eval "$(mjsim completion zsh)"    in ~/.zshrc
      fish  mjsim completion fish | source    in config.fish
    """
    from click.shell_completion import get_completion_class

    from mjsim.cli.main import main

    kind = get_completion_class(shell)
    assert kind is not None
    script = kind(main, {}, "mjsim", "_MJSIM_COMPLETE")
    text = script.source_template % script.source_vars()
    if not common.answered({"shell": shell, "script": text}):
        click.echo(text)
