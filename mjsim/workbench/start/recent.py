"""Campaigns that were opened last, so that the start page can list them."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path

from mjsim.io.files import write_whole

#: So many are kept.
_MOST = 8
#: The variable that turns off what mjsim keeps of its own.
_OFF = "MJSIM_CACHE"


def _file() -> Path:
    given = os.environ.get(_OFF)
    folder = Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mjsim"
    return folder / "recent.json"


def recent() -> list[Path]:
    """Folders of the campaigns opened last that are still there, the newest first."""
    if os.environ.get(_OFF) == "off":
        return []
    try:
        known = json.loads(_file().read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    folders = [Path(p) for p in known if isinstance(p, str)] if isinstance(known, list) else []
    return [p for p in folders if (p / "campaign.toml").is_file()]


def remember(folder: Path) -> None:
    """Put a campaign at the head of the list; nothing happens where it cannot be written."""
    if os.environ.get(_OFF) == "off":
        return
    folder = folder.absolute()
    kept = [folder, *(p for p in recent() if p != folder)][:_MOST]
    with contextlib.suppress(Exception):
        write_whole(_file(), json.dumps([str(p) for p in kept], indent=1), force=True)
