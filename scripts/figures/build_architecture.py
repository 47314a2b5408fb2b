"""The picture of the rooms in ARCHITECTURE.md (Mermaid) and in the documentation (docs/images/rooms.svg), from the
imports of the code.

Run it with the project's Python. An arrow says "imports from".
Arrows that follow from others are left out.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

from mjsim.plots import style
from mjsim.plots.save import save

ROOT = Path(__file__).resolve().parents[2]
PAGE, PICTURE = ROOT / "ARCHITECTURE.md", ROOT / "docs" / "images" / "rooms.svg"
BLOCK = re.compile(r"```mermaid\n.*?```", re.DOTALL)
#: What the modules beside the folders are called in the picture.
GROUND = "units, errors"


def room_of(module: str) -> str:
    """``mjsim.inference.fit`` -> ``inference``; modules beside the folders are one room; empty for the package
    itself.
    """
    part = [*module.split("."), ""][1]
    if part == "__main__":
        return "cli"
    return part if not part or (ROOT / "mjsim" / part).is_dir() else GROUND


def imports() -> dict[str, set[str]]:
    """Room -> the rooms from which its modules import."""
    out: dict[str, set[str]] = defaultdict(set)
    for file in (ROOT / "mjsim").rglob("*.py"):
        room = room_of(".".join(file.relative_to(ROOT).with_suffix("").parts))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("mjsim."):
                out[room].add(room_of(node.module or ""))
    names = [room for room in out if room and room != "__init__"]
    return {room: {r for r in out[room] if r in names or r == GROUND} - {room} for room in sorted({*names, GROUND})}


def reduced(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The arrows that do not follow from others."""

    def below(room: str) -> set[str]:
        return graph[room].union(*map(below, graph[room]))

    return {room: {r for r in to if not any(r in below(other) for other in to - {r})} for room, to in graph.items()}


def mermaid() -> str:
    """The picture as Mermaid source."""
    arrows = sorted((room, r) for room, to in reduced(imports()).items() for r in to)
    names = {room: "ground" if room == GROUND else room for pair in arrows for room in pair}
    return "\n".join(
        [
            "```mermaid",
            "graph TD",
            f'    ground["{GROUND}"]',
            *(f"    {names[a]} --> {names[b]}" for a, b in arrows),
            "```",
        ]
    )


def places(graph: dict[str, set[str]]) -> dict[str, tuple[float, int]]:
    """(x, level) of every room: one level above what it imports from; rooms of a level side by side, near what they
    import from.
    """

    def level(room: str) -> int:
        return 1 + max((level(r) for r in graph[room]), default=-1)

    out: dict[str, tuple[float, int]] = {}
    for k in range(1 + max(map(level, graph))):
        rooms = [r for r in graph if level(r) == k]
        rooms.sort(key=lambda r: (sum(out[b][0] for b in graph[r]) / max(1, len(graph[r])), r))
        for i, room in enumerate(rooms):
            out[room] = 2.1 * (i - 0.5 * (len(rooms) - 1)), k
    return out


def draw() -> None:
    """Write the picture."""
    graph = reduced(imports())
    at = places(graph)
    top = max(y for _, y in at.values())
    figure = style.new_figure(5.6, 0.62 * (top + 1))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-2.8, 2.8), ylim=(-0.6, top + 0.6))
    axes.axis("off")
    for room, to in graph.items():
        for other in sorted(to):
            far = at[room][1] - at[other][1] > 1
            bend = "arc3,rad=0.25" if far and at[room][0] >= 0 else "arc3,rad=-0.25" if far else "arc3"
            (x, y), (u, v) = at[room], at[other]
            look = {
                "arrowstyle": "->",
                "color": style.NOMINAL,
                "linewidth": 0.9,
                "connectionstyle": bend,
                "shrinkA": 11,
                "shrinkB": 13,
            }
            axes.annotate("", (u, v), (x, y), arrowprops=look, zorder=1)
    for room, (x, y) in at.items():
        box = {"boxstyle": "round,pad=0.35", "facecolor": style.BAND, "edgecolor": style.BAND_EDGE}
        axes.text(x, y, room, ha="center", va="center", fontsize=style.TEXT, color=style.INK, bbox=box, zorder=2)
    save(figure, PICTURE)


def main() -> None:
    """Write the Mermaid block and the picture."""
    PAGE.write_text(BLOCK.sub(lambda _: mermaid(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    draw()


if __name__ == "__main__":
    main()
