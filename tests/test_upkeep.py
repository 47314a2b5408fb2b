"""What keeps the repository in order: lint, format, types, layers, pins. Nothing here runs a simulation."""

import ast
import hashlib
import importlib
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import mjsim

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
MODULES = {
    ".".join(f.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): f
    for f in sorted((ROOT / "mjsim").rglob("*.py"))
}
#: A text that names axes, an error of theirs, or an effect on one: X, XYZ, EXC, EC0A, backlash.A.
AXES = re.compile(r"([a-z_]+\.)?([XYZABC]{1,5}|E[XYZABC]0?[XYZABC])")
#: Modules and packages that may spell out axes, and why.
NAMES_AXES = {
    "mjsim.machine.axis": "says which letters there are",
    "mjsim.units": "says what the ampere is called",
    "mjsim.nc.words": "AC is a word of Sinumerik for an absolute number",
    "mjsim.nc.klartext": "C and CC are statements of HEIDENHAIN Klartext",
    "mjsim.paper": "reproduces the figures of one published machine",
    "mjsim.importing.features": "a .b5r file calls the two axes of its plane A and B, whatever they are",
}
#: What no file of the repository speaks of, each written so that it does not match itself: places on the machine of
#: whoever wrote it, sittings at it, hosts of package registries.
FORBIDDEN = {
    "machine path": r"/wor[k]/|/tm[p]/[a-z]+/|/hom[e]/[a-z]|/roo[t]/",
    "registry host": r"pyp[i]\.org|pythonhoste[d]\.org|npmj[s]\.(org|com)|proxy\.golan[g]",
    "sitting": r'(?<!scope=")(?<!pytest_)(?<!\()\bsession[s]?\b(?!\))',
}


def run(*command):
    return subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)


def run_script(name, *arguments):
    """What a script of the repository prints."""
    command = [sys.executable, ROOT / "scripts" / name, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def tracked():
    """Files of the repository, or of its source distribution."""
    if (ROOT / ".git").exists():
        names = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.split("\0")
        return [ROOT / n for n in names if n and (ROOT / n).is_file()]
    return [
        f
        for f in ROOT.rglob("*")
        if f.is_file() and not any(p.startswith((".", "__pycache__")) for p in f.relative_to(ROOT).parts)
    ]


@pytest.mark.parametrize("command", [("ruff", "check", "."), ("ruff", "format", "--check", ".")], ids=" ".join)
def test_lint_and_format(command):
    result = run(*command)
    assert result.returncode == 0, result.stdout + result.stderr


def _checked_for_types():
    """Fingerprint of all that the type checker reads: the package, its stubs, its settings, installed versions."""
    digest = hashlib.sha256(sys.version.encode())
    for file in [
        *MODULES.values(),
        *sorted((ROOT / "mjsim").rglob("*.pyi")),
        *sorted((ROOT / "typings").rglob("*.pyi")),
    ]:
        digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    digest.update((ROOT / "pyproject.toml").read_bytes())
    digest.update(repr(sorted((d.name, d.version) for d in distributions())).encode())
    return digest.hexdigest()


@pytest.mark.slow
def test_types(monkeypatch, pytestconfig):
    """Without a look for newer versions; warnings count as well. What has passed unchanged is not checked again."""
    state = _checked_for_types()
    if pytestconfig.cache.get("mjsim/types", "") == state:
        return
    monkeypatch.setenv("PYRIGHT_PYTHON_IGNORE_WARNINGS", "1")
    result = run("pyright", "--warnings", "--pythonpath", sys.executable)
    assert result.returncode == 0 and "0 errors, 0 warnings" in result.stdout, result.stdout + result.stderr
    pytestconfig.cache.set("mjsim/types", state)


def _declared(body):
    """Public names that a stub declares at its top or in a class, with the bodies of classes."""
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, getattr(node, "body", [])
        elif (
            isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and not node.target.id.startswith("_")
        ):
            yield node.target.id, []


@pytest.mark.parametrize("module", ["mujoco", "mujoco.rollout", "numba", "numba.extending", "numba.types"])
def test_stubs_name_what_there_is(module):
    place = ROOT / "typings" / Path(*module.split("."))
    stub = place / "__init__.pyi" if place.is_dir() else place.with_suffix(".pyi")
    real = importlib.import_module(module)
    names = list(_declared(ast.parse(stub.read_text()).body))
    assert names
    for name, body in names:
        if module == "numba" and name == "CFunc":  # lives deeper
            continue
        assert hasattr(real, name), f"{stub}: {module} has no {name}"
        for inner, _ in _declared([n for n in body if isinstance(n, ast.FunctionDef | ast.AnnAssign)]):
            if module == "mujoco":  # compiled: even the fields are there without an instance
                assert hasattr(getattr(real, name), inner), f"{stub}: {module}.{name} has no {inner}"


def test_type_checkers_see_the_names_of_the_package():
    seen, shown = {}, []
    for node in ast.parse((ROOT / "mjsim" / "__init__.pyi").read_text()).body:
        if isinstance(node, ast.ImportFrom):
            seen |= {alias.asname or alias.name: (node.module, alias.name) for alias in node.names}
        elif isinstance(node, ast.Assign):
            shown = ast.literal_eval(node.value)
    assert seen == {n: (module, mjsim._RENAMED.get(n, n)) for n, module in mjsim._WHERE.items()}
    assert set(shown) == set(mjsim.__all__)


def _imports(file):
    """Modules of mjsim that a file imports, at its top or later, for types alone as well."""

    def visit(node):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ImportFrom) and (child.module or "").partition(".")[0] == "mjsim":
                for alias in child.names:
                    whole = f"{child.module}.{alias.name}"
                    yield whole if whole in MODULES else child.module
            elif isinstance(child, ast.Import):
                yield from (a.name for a in child.names if a.name.partition(".")[0] == "mjsim")
            yield from visit(child)

    return set(visit(ast.parse(file.read_text())))


def _layers():
    """Part of mjsim -> row of the table in ARCHITECTURE.md."""
    rows = (ROOT / "ARCHITECTURE.md").read_text().partition("| folders and modules |")[2].splitlines()[2:]
    out = {}
    for number, row in enumerate(rows[: rows.index("")]):
        for name in re.findall(r"`(\w+)(?:/|\.py)`", row.split("|")[1]):
            assert name not in out, name
            out[name] = number
    return out


def _part(module):
    return [*module.split("."), "__init__"][1]


def test_every_part_is_in_the_architecture():
    assert set(_layers()) == {_part(m) for m in MODULES} - {"__init__"}


def test_imports_go_one_way():
    layers = _layers()
    rooms = {m: file for m, file in MODULES.items() if m != "mjsim"}  # the package itself only hands names on
    wrong = [
        f"{m} imports {t}"
        for m, file in rooms.items()
        for t in _imports(file) - {"mjsim"}
        if layers[_part(t)] > layers[_part(m)]
    ]
    assert not wrong, "\n".join(wrong)


def test_no_modules_import_each_other():
    graph = defaultdict(set, {m: _imports(file) - {m} for m, file in MODULES.items()})
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def _texts(file):
    """Texts in a module's code with their lines; docstrings are none."""
    tree = ast.parse(file.read_text())
    owners = [n for n in ast.walk(tree) if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)]
    said = {n.body[0].value for n in owners if n.body and isinstance(n.body[0], ast.Expr)}
    return [
        (n.lineno, n.value)
        for n in ast.walk(tree)
        if isinstance(n, ast.Constant) and isinstance(n.value, str) and n not in said
    ]


def test_axes_come_from_the_machine():
    found = {m: [(line, text) for line, text in _texts(file) if AXES.fullmatch(text)] for m, file in MODULES.items()}
    allowed = {m: next((n for n in NAMES_AXES if f"{m}.".startswith(f"{n}.")), None) for m in found}
    wrong = [f"{MODULES[m]}:{line}: {text!r}" for m, hits in found.items() if not allowed[m] for line, text in hits]
    assert not wrong, "\n".join(["axes spelled out (take them from the machine's chain):", *wrong])
    assert {allowed[m] for m, hits in found.items() if hits} == set(NAMES_AXES)


def test_the_repository_speaks_of_the_project_only():
    found = []
    for file in tracked():
        try:
            text = file.read_text()
        except UnicodeDecodeError:  # an image, a solid, a compressed trace
            continue
        for what, pattern in FORBIDDEN.items():
            for match in re.finditer(pattern, text):
                line = text.count("\n", 0, match.start()) + 1
                found.append(f"{file.relative_to(ROOT)}:{line}: {what} {match[0]!r}")
    assert not found, "\n".join(found)


def test_python_versions_are_declared_alike():
    project = PROJECT["project"]
    low, high = map(int, re.fullmatch(r">=3\.(\d+),<3\.(\d+)", project["requires-python"]).groups())
    names = [c.rpartition(" :: ")[2] for c in project["classifiers"] if re.search(r":: 3\.\d+$", c)]
    assert names == [f"3.{minor}" for minor in range(low, high)]
    assert (
        PROJECT["tool"]["pyright"]["pythonVersion"] == names[0]
        and PROJECT["tool"]["ruff"]["target-version"] == f"py3{low}"
    )
    for page in ("README.md", "CONTRIBUTING.md"):
        assert f"Python {names[0]} to {names[-1]}" in (ROOT / page).read_text(), page


def test_dependencies_are_ranges_with_a_reason_and_the_lock_has_one_version_of_each():
    text = (ROOT / "pyproject.toml").read_text()
    locked = dict(re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    project = PROJECT["project"]
    tables = [
        project["dependencies"],
        *project["optional-dependencies"].values(),
        *PROJECT["dependency-groups"].values(),
    ]
    for requirement in (r for table in tables for r in table):
        assert re.search(rf'"{re.escape(requirement)}", *# \w', text), f"{requirement}: no reason in pyproject.toml"
        wanted = Requirement(requirement)
        if wanted.name != "mjsim":
            assert any(s.operator == ">=" for s in wanted.specifier), f"{requirement}: no lower bound"
            assert not any(s.operator == "==" for s in wanted.specifier), (
                f"{requirement}: a pin, which belongs into the lock"
            )
            assert locked[wanted.name] in wanted.specifier, (
                f"{requirement}: requirements.lock has {locked[wanted.name]}"
            )


def test_the_lock_has_hashes_and_no_addresses():
    text = (ROOT / "requirements.lock").read_text()
    assert "://" not in text and "--index" not in text
    for entry in re.split(r"(?m)^(?=\w)", text)[1:]:
        assert "--hash=sha256:" in entry, entry


@pytest.mark.parametrize("groups", [[], ["report"], ["all"], ["all", "build", "docs", "dev"]], ids=" ".join)
def test_the_part_of_the_lock_that_a_group_needs(groups):
    part = run_script("locked.py", *groups)
    names = set(re.findall(r"^[\w.-]+(?===)", part, re.MULTILINE))
    assert names >= {"mujoco", "numpy", "scipy", "numba", "llvmlite", "matplotlib", "trimesh", "pydantic-core"}
    assert ("jinja2" in names, "markupsafe" in names) == 2 * (bool(groups),)
    assert ("pandas" in names, "av" in names) == 2 * ("all" in groups,)
    if "dev" in groups:
        assert part.splitlines() == [
            line for line in (ROOT / "requirements.lock").read_text().splitlines() if line[:1] != "#"
        ]


def test_the_workflow_runs_every_python():
    versions = re.search(r"python: \[(.*)\]", (ROOT / ".github" / "workflows" / "test.yml").read_text())[1]
    minors = map(int, re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["project"]["requires-python"]).groups())
    assert versions == ", ".join(f'"3.{minor}"' for minor in range(*minors))


def test_the_citation_says_what_the_project_says():
    yaml = pytest.importorskip("yaml", reason="comes with the group docs")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = PROJECT["project"]
    assert citation["version"] == project["version"] == mjsim.__version__
    assert (citation["license"], citation["keywords"]) == (project["license"], project["keywords"])
    assert [a["name"] for a in citation["authors"]] == [a["name"] for a in project["authors"]]
