"""What the command line calls the keys of a ``[[test]]`` table: for its options, and for messages that ask for one."""

from __future__ import annotations

#: Key -> option.
OPTION = {
    "kind": "--kind", "plane": "--plane", "axis": "--axis", "from_deg": "--from", "to_deg": "--to", "half_apex_deg": "--half-apex",
    "inclination_deg": "--inclination", "sensitive_direction": "--sensitive", "direction": "--direction",
    "revolutions": "--revolutions", "table_ball_mm": "--table-ball", "bar_length_mm": "--length", "feed_mm_min": "--feed",
    "setup": "--setup", "started_s": "--started",
}  # fmt: skip
