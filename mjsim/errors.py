"""Errors that a user can act on."""


class InputError(ValueError):
    """The input is wrong; the message is one sentence that names the place, what was found and what is allowed.

    The command line prints the message and ends with status 1. Nothing has been written when it is raised.
    """


class SimulationError(RuntimeError):
    """The simulation cannot be trusted (MuJoCo warned, or a value is not finite); the message says what to change."""
