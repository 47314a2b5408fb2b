"""Errors that a user can act on."""

import difflib
from collections.abc import Iterable

#: Longest message, characters.
LONGEST = 600


def shortened(text: str, longest: int = LONGEST) -> str:
    """A text on one line, what cannot be printed as a blank, its middle left out where it is too long."""
    text = "".join(c if c.isprintable() else " " for c in " ".join(text[: 20 * longest].split()))
    if len(text) <= longest:
        return text
    return f"{text[: 2 * longest // 3]} … {text[-longest // 4 :]}"


def probably_meant(word: str, known: Iterable[str]) -> str:
    """What a message says behind an unknown word: the one of those that are known which was probably meant, or nothing
    where none is near.
    """
    near = difflib.get_close_matches(word, [*known], n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


class InputError(ValueError):
    """The input is wrong; the message is one sentence that names the place, what was found and what is allowed.

    The command line prints the message and ends with status 1. Nothing has been written when it is raised. Whatever was
    found (a name of a thousand letters), the message stays one line of bounded length.
    """

    def __init__(self, message: str) -> None:
        super().__init__(shortened(message))


class SimulationError(RuntimeError):
    """The simulation cannot be trusted (MuJoCo warned, or a value is not finite); the message says what to change."""
