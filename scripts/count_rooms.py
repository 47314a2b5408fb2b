"""How large each room of the package is, and how many numbers steer an answer.

    python scripts/count_rooms.py [FOLDER]

FOLDER is a checkout; this one by default. A room is a folder of ``mjsim/``. A module with one importer usually belongs
into it. A number decides where it is a default of a class of settings, or a constant of a module in the rooms that
answer (``inference``, ``commands``); sizes of numerical steps are among them.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path

#: Rooms whose numbers steer an answer.
DECIDING = ("inference", "commands")


def main() -> None:
    """Print the table."""
    root = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent.parent)
    trees = {name_of(f, root): (f, ast.parse(f.read_text(encoding="utf-8"))) for f in (root / "mjsim").rglob("*.py")}
    importers: Counter[str] = Counter()
    for name, (_, tree) in trees.items():
        importers.update(m for m in imports_of(tree) & trees.keys() if m != name)
    rows: dict[str, list[int]] = {}
    for name, (file, tree) in trees.items():
        inside = file.relative_to(root / "mjsim").parts
        room = inside[0] if len(inside) > 1 else "top level"
        lines, modules, alone, numbers = rows.get(room, [0, 0, 0, 0])
        count = len(file.read_text(encoding="utf-8").splitlines())
        one = importers[name] == 1 and file.name != "__init__.py"
        deciding = numbers_of(tree) if room in DECIDING else 0
        rows[room] = [lines + count, modules + 1, alone + one, numbers + deciding]
    print(f"{'room':14} {'lines':>7} {'modules':>8} {'one importer':>13} {'numbers':>8}")
    for room, row in [*sorted(rows.items()), ("all", [sum(column) for column in zip(*rows.values(), strict=True)])]:
        print(f"{room:14} {row[0]:7} {row[1]:8} {row[2]:13} {row[3]:8}")


def name_of(file: Path, root: Path) -> str:
    """Dotted name of a module."""
    parts = file.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(tree: ast.Module) -> set[str]:
    """Names that a module imports from the package, with those that may be modules."""
    out: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("mjsim"):
            out |= {str(node.module), *(f"{node.module}.{a.name}" for a in node.names)}
        elif isinstance(node, ast.Import):
            out |= {a.name for a in node.names}
    return out


def numbers_of(tree: ast.Module) -> int:
    """Numbers among the constants of a module and the defaults of its settings."""
    found = 0
    for node in tree.body:
        if isinstance(node, ast.Assign) and all(isinstance(t, ast.Name | ast.Tuple) for t in node.targets):
            names = [n.id for t in node.targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            if names and all(n.isupper() for n in names):
                found += numeric(node.value)
        elif isinstance(node, ast.ClassDef) and node.name.endswith("Settings"):
            found += sum(numeric(n.value) for n in node.body if isinstance(n, ast.AnnAssign) and n.value)
    return found


def numeric(value: ast.expr) -> int:
    """How many plain numbers an expression has, calls and texts left out."""
    return sum(isinstance(n, ast.Constant) and type(n.value) in (int, float) for n in ast.walk(value))


if __name__ == "__main__":
    main()
