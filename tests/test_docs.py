"""The documentation: its examples run, its links lead somewhere, its site builds."""

import doctest
import importlib
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest

import mjsim
from mjsim.cli.main import main
from mjsim.effects.registry import kinds
from mjsim.errors import InputError
from mjsim.importing.formats import base as formats
from mjsim.importing.reading import Options
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.kinematics import reading

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "examples" / "README.md", ROOT / "models" / "README.md"]
)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)#\s]+)[^)]*\)")


@pytest.mark.slow
def test_examples_of_the_python_page_run():
    failed, tried = doctest.testfile(
        str(ROOT / "docs" / "python.md"), module_relative=False, optionflags=doctest.ELLIPSIS
    )
    assert tried >= 10
    assert failed == 0


def test_examples_in_docstrings_run():
    tried = 0
    for file in sorted(Path(mjsim.__file__).parent.rglob("*.py")):
        if ">>>" in file.read_text(encoding="utf-8"):
            name = ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            result = doctest.testmod(importlib.import_module(name))
            assert result.failed == 0 < result.attempted, name
            tried += result.attempted
    assert tried >= 5


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" not in target and not target.startswith("mailto:"):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name in text, page.name


def test_every_public_name_is_typed_and_documented():
    """What ``import mjsim`` offers has a docstring, and the package says that it is typed."""
    assert (Path(mjsim.__file__).parent / "py.typed").is_file()
    for name in mjsim.__all__:
        if name != "__version__":
            assert getattr(mjsim, name).__doc__, name


@pytest.mark.slow
def test_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("mkdocs", reason="the extra mjsim[docs] is not installed")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    page = (tmp_path / "site" / "reference.html").read_text()
    assert "read_campaign" in page and "Diagnosis" in page
    for file in (tmp_path / "site").rglob("*.html"):
        assert not re.search(
            r'(?:src|href)="https?://(?!squidfunk|www\.|mujoco|pypi)[^"]*\.(?:js|css|woff2?)"', file.read_text()
        ), file


def test_reference_lists_every_public_function():
    """Functions of ``import mjsim`` are in the reference, under the module that defines them."""
    listed = set(re.findall(r"^::: (\S+)", (ROOT / "docs" / "reference.md").read_text(), re.MULTILINE))
    for name in mjsim.__all__:
        thing = getattr(mjsim, name)
        if callable(thing) and not isinstance(thing, type):
            assert f"{thing.__module__}.{thing.__name__}" in listed, name


def script_of(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / "figures" / f"{name}.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def test_the_catalogue_is_up_to_date():
    """The page of effects says what the classes say, and every kind has its picture."""
    script = script_of("build_catalogue")
    assert script.PAGE.read_text(encoding="utf-8") == script.page(), "run scripts/figures/build_catalogue.py"
    drawn = {kind for kind, cls in script.shipped().items() if not cls.for_logs}
    assert {f.stem for f in script.IMAGES.glob("*.svg")} == drawn >= set(script.PANELS)


def test_the_picture_of_the_rooms_is_up_to_date():
    script = script_of("build_architecture")
    assert script.mermaid() in script.PAGE.read_text(encoding="utf-8"), "run scripts/figures/build_architecture.py"
    assert script.PICTURE.is_file()


def test_what_the_architecture_names_exists():
    """Modules, and what they define, as ``inference.fit`` or ``machine.model.build``."""
    rooms = {p.name for p in (ROOT / "mjsim").iterdir() if p.is_dir()}
    named = re.findall(r"`(\w+(?:\.\w+)+)`", (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8"))
    named = [n for n in named if n.split(".")[0] in rooms and not n.endswith(".toml")]
    assert len(named) > 5
    for name in named:
        module, _, last = f"mjsim.{name}".rpartition(".")
        above = importlib.import_module(module)
        assert hasattr(above, last) or importlib.util.find_spec(f"mjsim.{name}"), name


def test_the_readme_is_short_and_names_every_command():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 150
    named = set(re.findall(r"mjsim (\w+)", text))
    commands = set(main.list_commands(click.Context(main)))
    assert commands <= named, commands - named
    (number,) = re.findall(r"some \[(\d+) kinds of effects", text)
    assert abs(int(number) - len(kinds())) < 5


def test_prose_is_wrapped_at_100_columns():
    pages = [p for p in PAGES if p.parent.name != "models"]
    long = []
    for page in pages:
        fenced = False
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
            fenced ^= line.startswith("```")
            if (
                len(line) > 100
                and not fenced
                and not line.startswith(("|", "![", "    ", "<!--"))
                and line.count(" ") > 3
            ):
                long.append(f"{page.name}:{number}")
    assert not long, "\n".join(long)


def code_of(page, words):
    """The code block of a page that contains the words, as it runs; the names that it defines."""
    text = (ROOT / page).read_text(encoding="utf-8")
    block = next(b for b in re.findall(r"(?:^    .*\n|^\n)+", text, re.MULTILINE) if words in b)
    names = {"__name__": "example"}
    exec(re.sub(r"^    ", "", block, flags=re.MULTILINE), names)
    return names


@pytest.mark.parametrize("page", ["docs/how-to-effect.md", "CONTRIBUTING.md"])
def test_the_effects_of_the_documentation_work(page):
    """The class of each page moves its axis by its parameter."""
    cls = code_of(page, "@mjsim.register")["ScrewWave"]
    (parameter,) = cls.parameters
    effect = cls(cls.subjects[0], **{parameter.name: 2.0})
    q = np.linspace(-0.1, 0.1, 401)[:, None] * np.ones(5)
    moved = effect.position_error(mjsim.Motion(q[:, 0], q[:, 0], q, q, q, q, q, FIVE_AXIS.letters))
    assert moved.shape == q.shape and np.abs(moved).max() == pytest.approx(effect.si(parameter.name), rel=1e-3)


def test_the_test_kind_of_the_documentation_works():
    before = dict(KINDS)
    try:
        kind = code_of("CONTRIBUTING.md", "class Latitude")["Latitude"]()
        (test,) = kind.proposals(FIVE_AXIS, 0.1, 0.155)
        phi = np.linspace(-0.1, 6.4, 500)
        q = kind.path(test, phi)
        assert np.abs(reading(FIVE_AXIS, q, np.array(test.table_ball), test.length)).max() < 1e-12
        assert np.abs(np.unwrap(kind.angle(test, q)) - phi).max() < 1e-9
    finally:
        KINDS.clear()
        KINDS.update(before)


def test_the_file_format_of_the_documentation_works(monkeypatch, tmp_path):
    monkeypatch.setattr(formats, "_FORMATS", {})
    code_of("CONTRIBUTING.md", "class JSON")
    file = tmp_path / "run.json"
    file.write_text('{"t_ms": [0, 5, 10], "r_um": [0.1, 0.2, 0.3]}')
    table = formats.read_any(file, Options())
    assert table.names == ("time", "deviation") and table.values.shape == (3, 2)
    for wrong in ('{"t_ms": [0]}', "[1]", "3", "{", '{"t_ms": [0, 1], "r_um": [0]}', '{"t_ms": ["x"], "r_um": [0]}'):
        file.write_text(wrong)
        with pytest.raises(InputError, match=r"run\.json: .*allowed: .*t_ms and r_um|an object with both"):
            formats.read_any(file, Options())
    with pytest.raises(InputError, match="--rows is for tables of text"):
        formats.read_any(file, Options(rows=(1, 2)))
