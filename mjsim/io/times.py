"""The times of samples in files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mjsim.errors import InputError


def check_growing(path: Path, time: np.ndarray, line: Callable[[int], int]) -> None:
    """Refuse times that stand still or run backwards.

    Args:
        path: The file, for the message.
        time: (n,) s.
        line: Of the file, in which a sample stands.

    Raises:
        InputError: Names the line.
    """
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i = int(back[0])
        raise InputError(
            f"{path}, line {line(i + 1)}: time_s = {time[i + 1]:g} after {time[i]:g}; allowed: times that grow from "
            f"line to line"
        )
