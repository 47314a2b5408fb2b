"""Pages of the site that are files at the top of the repository: a page of docs/ that names one with ``<!-- file:
NAME -->`` shows it.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROOMS = "![Rooms of the code; an arrow means: imports from](images/rooms.svg)"


def on_page_markdown(markdown: str, **_: object) -> str:
    """The page's text, or that of the file that it names, with links as seen from docs/ and the picture in place of
    its Mermaid source.
    """
    named = re.search(r"<!-- file: (\S+) -->", markdown)
    if not named:
        return markdown
    text = (ROOT / named[1]).read_text(encoding="utf-8")
    text = re.sub(r"\]\((?![a-z]+:|#)", "](../", text)
    text = text.replace("](../docs/", "](")
    for name in ("ARCHITECTURE", "CONTRIBUTING", "CHANGELOG"):
        text = text.replace(f"](../{name}.md", f"]({name.lower()}.md")
    return re.sub(r"```mermaid\n.*?```", lambda _: ROOMS, text, flags=re.DOTALL)
