"""What the command line calls the keys of a ``[[test]]`` table: for its options, and for messages that ask for one."""

from __future__ import annotations

from mjsim.instruments.ball_bar.kinds import all_keys


def options() -> dict[str, str]:
    """Key -> option, in the order of a ``[[test]]`` table: those of single kinds lie between ``kind`` and the table
    ball.
    """
    return {
        "kind": "--kind",
        **{name: keys[0].flag for name, keys in all_keys().items()},
        "table_ball_mm": "--table-ball",
        "bar_length_mm": "--length",
        "feed_mm_min": "--feed",
        "setup": "--setup",
        "started_s": "--started",
        "spindle_deg": "--spindle",
    }
