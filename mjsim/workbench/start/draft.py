"""A campaign that is being put together from a template, a plan and dropped files.

It is a whole campaign in a folder of its own, made by the same functions as ``mjsim new``, ``mjsim plan`` and
``mjsim import`` use. Only :meth:`Draft.write` puts it where the user wants it, all of it or nothing.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit

from mjsim.campaign.files import campaign_from, read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.campaign.machine_templates import MachineTemplate, template_named
from mjsim.campaign.model import Campaign
from mjsim.campaign.new import (
    axis_table,
    check_new_folder,
    check_position_gain,
    log_campaign_text,
    machine_text,
    planned_text,
)
from mjsim.commands.check import check
from mjsim.errors import InputError
from mjsim.importing.b5r import looks_like_xml, read_recorded
from mjsim.importing.features import import_features, read_features
from mjsim.importing.formats import read_any
from mjsim.importing.importer import ImportedTrace, import_traces
from mjsim.importing.into_campaign import test_name
from mjsim.importing.logs import ImportedLog, columns_of, import_log
from mjsim.importing.points import import_points
from mjsim.importing.reading import Options
from mjsim.importing.sources import test_keys
from mjsim.importing.table import Table
from mjsim.inference.mistakes.sense import with_other_sense
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.ball_bar.kinds import KINDS
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import INSTRUMENTS as EVERY
from mjsim.instruments.r_test.measurement import SphereReading
from mjsim.io.files import check_writable, write_all, write_whole
from mjsim.io.toml import parse, read_text
from mjsim.machine.chain import FIVE_AXIS
from mjsim.machine.model import Machine
from mjsim.nc.write import Options as NcOptions
from mjsim.nc.write import zipped_programs

#: Instruments that a campaign is started for, and what the user calls them.
INSTRUMENTS = {
    BallBarTest.instrument: "a ball bar",
    SphereReading.instrument: "an R-test",
    LogTest.instrument: "the control (axis logs)",
}
#: Endings of NC programs.
PROGRAMS = (".nc", ".ngc", ".tap", ".mpf", ".spf", ".h", ".cnc", ".eia", ".min")
#: Largest file that may be dropped, bytes.
LARGEST = 200_000_000


@dataclass
class Dropped:
    """A file with a trace or a log, as far as it was understood.

    Attributes:
        path: Where it is kept.
        columns: Its columns and their units, in words.
        keys: Of a ``[[test]]`` table, as header and name of the file suggest them; the user corrects them.
        test: Name of the test that it was brought in for; empty while it is not.
        notes: What was found and concluded.
        questions: What looks wrong.
        problem: Why it was not brought in; empty where it was.
    """

    path: Path
    columns: str = ""
    keys: dict[str, Any] = field(default_factory=dict)
    test: str = ""
    notes: tuple[str, ...] = ()
    questions: tuple[str, ...] = ()
    problem: str = ""


class Draft:
    """A campaign in the making.

    Args:
        folder: Of a campaign that lacks traces, which are written straight into it; ``None`` for a new one.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._temporary = tempfile.TemporaryDirectory(prefix="mjsim-start-")
        self._drop = Path(self._temporary.name) / "dropped"
        self._drop.mkdir()
        self.existing = folder is not None
        self.folder = folder if folder is not None else Path(self._temporary.name) / "campaign"
        self.folder.mkdir(exist_ok=True)
        self.template: MachineTemplate | None = None
        self.files: dict[str, Dropped] = {}
        self.said: list[str] = []
        self.instrument = BallBarTest.instrument
        self._force = not self.existing  # what was written earlier is not replaced
        if self.existing:
            self.instrument = next(iter(read_campaign(self.folder, traces=False).instruments))

    def close(self) -> None:
        """Take the files of the draft away."""
        self._temporary.cleanup()

    # -- the machine ---------------------------------------------------------------------------------------------------

    @property
    def machine(self) -> Machine | None:
        """The machine, once it was chosen."""
        file = self.folder / "machine.toml"
        return read_machine(file) if file.is_file() else None

    def choose_template(self, name: str, position_gain: float | None = None) -> Machine:
        """Begin with a template.

        Args:
            name: Of the template.
            position_gain: Of all axes, as set in the control, 1/s.

        Raises:
            InputError: There is no such template, or the tests that are there need another machine.
        """
        template = template_named(name)
        check_position_gain(position_gain)
        self._put_machine(machine_text(template.chain, template.name, template, position_gain))
        self.template = template
        return self._machine()

    def set_drives(self, numbers: dict[tuple[str, str], float]) -> None:
        """Change numbers of the drives.

        Args:
            numbers: By axis and key of its ``[drive.AXIS]``, such as ``("X", "lead_mm")``.

        Raises:
            InputError: A number is not possible.
        """
        document = tomlkit.parse(read_text(self.folder / "machine.toml"))
        drives: Any = document["drive"]
        for (axis, key), value in numbers.items():
            if drives[axis].get(key) != value:
                drives[axis][key] = value
        self._put_machine(tomlkit.dumps(document))

    def set_sense(self, axis: str, sense: str) -> None:
        """Say in which sense a rotary axis counts.

        Args:
            axis: Its letter.
            sense: One of :data:`mjsim.machine.chain.SENSES`.

        Raises:
            InputError: The tests that are there do not fit it.
        """
        machine, text = self._machine(), read_text(self.folder / "machine.toml")
        if sense == machine.chain.sense(axis):
            return
        chain = with_other_sense(machine, axis).chain
        old, new = (axis_table(c, c.axis(axis)) for c in (machine.chain, chain))
        if old in text:
            self._put_machine(text.replace(old, new))
            return
        document: Any = tomlkit.parse(text)  # a file of the user's
        table = document.setdefault("axis", tomlkit.table(True)).setdefault(axis, tomlkit.table())
        if "direction" in table:
            table["direction"] = [-float(v) or 0.0 for v in table["direction"]]
        table["sense"] = sense
        self._put_machine(tomlkit.dumps(document))

    def _put_machine(self, text: str) -> None:
        """Take a machine file if it can be read, and the tests fit it."""
        file = self.folder / "machine.toml"
        before = file.read_bytes() if file.is_file() else None
        read_machine(file, text)
        write_whole(file, text, force=True)
        try:
            if (self.folder / "campaign.toml").is_file():
                self._look(read_text(self.folder / "campaign.toml"))
            else:
                self._begin_campaign()
        except InputError:
            if before is None:
                file.unlink()
            else:
                file.write_bytes(before)
            raise

    def _machine(self) -> Machine:
        machine = self.machine
        if machine is None:
            raise InputError("No machine is chosen yet; choose one first.")
        return machine

    # -- the instrument and the tests ----------------------------------------------------------------------------------

    def choose_instrument(self, name: str, numbers: dict[str, float] | None = None) -> None:
        """Say what measures.

        Args:
            name: One of :data:`INSTRUMENTS`.
            numbers: Keys of its ``[instrument]`` table, for a ball bar.

        Raises:
            InputError: A number is not possible, or files of the other instrument are there.
        """
        if name != self.instrument and self.tests:
            raise InputError(
                f"The campaign has tests for {INSTRUMENTS[self.instrument]} already; take them out, or begin another "
                f"campaign for {INSTRUMENTS[name]}."
            )
        if name != self.instrument:
            self.instrument = name
            if self.machine is not None:
                self._begin_campaign()
        if numbers and self.machine is not None:
            self._edit(lambda document: document["instrument"].update(numbers))

    @property
    def campaign(self) -> Campaign | None:
        """The campaign as far as it is there, without its traces; ``None`` before it has a test."""
        file = self.folder / "campaign.toml"
        if not file.is_file():
            return None
        data = parse(file)
        return campaign_from(file, data, traces=False) if data.get("test") else None

    @property
    def tests(self) -> list[dict[str, Any]]:
        """Tables of the tests."""
        file = self.folder / "campaign.toml"
        return list(parse(file).get("test", [])) if file.is_file() else []

    def add_tests(self, tables: Sequence[dict[str, Any]]) -> None:
        """Add the tests of a plan that are not there yet.

        Raises:
            InputError: No machine is chosen, or it cannot run one.
        """
        self._machine()
        new = [t for t in tables if t["name"] not in {t["name"] for t in self.tests}]
        if new:
            self._edit(lambda document: _append(document, new))

    def remove_test(self, name: str) -> None:
        """Take a test and its trace out."""

        def take_out(document: Any) -> None:
            places = [i for i, t in enumerate(document["test"]) if t["name"] == name]
            for place in reversed(places):
                del document["test"][place]
            if not len(document["test"]):
                del document["test"]

        self._edit(take_out)
        for dropped in self.files.values():
            if dropped.test == name:
                dropped.test = ""

    def set_limits(self, instrument_um: float, limits: Sequence[tuple[str, str, float, str]]) -> None:
        """State limits of acceptance.

        Args:
            instrument_um: Expanded uncertainty of the bar, as its certificate says.
            limits: Test, figure, limit in µm, source.

        Raises:
            InputError: A limit is not possible.
        """
        rows = [{"tests": [t], "figure": f, "um": um, "source": source} for t, f, um, source in limits]

        def put(document: Any) -> None:
            document.pop("acceptance", None)
            if rows:
                document["acceptance"] = {"instrument_um": instrument_um, "limit": rows}

        self._edit(put)

    @property
    def in_motion(self) -> bool:
        """Whether the instrument measures along programs: tests are planned for it."""
        return EVERY[self.instrument].in_motion

    def _begin_campaign(self) -> None:
        """A campaign.toml without a test, for the instrument that is chosen."""
        text = planned_text("new", [], self.instrument) if self.in_motion else log_campaign_text("new")
        write_whole(self.folder / "campaign.toml", text, force=True)

    def _edit(self, change: Callable[[Any], None]) -> None:
        """Change campaign.toml, whose comments and order stay; nothing is written where no command would read it."""
        file = self.folder / "campaign.toml"
        document = tomlkit.parse(read_text(file))
        change(document)
        text = tomlkit.dumps(document)
        self._look(text)
        write_whole(file, text, force=True)

    def _look(self, text: str) -> None:
        """Refuse a campaign.toml that no command would read.

        Raises:
            InputError: What is wrong, without the folder of the draft.
        """
        file = self.folder / "campaign.toml"
        try:
            campaign_from(file, tomlkit.parse(text).unwrap(), traces=False, empty=True)
        except InputError as error:
            raise InputError(self.plain(error)) from None

    # -- files ---------------------------------------------------------------------------------------------------------

    def drop(self, name: str, data: bytes) -> str:
        """Take a dropped file: a trace or a log, a ``.b5r`` file, a machine or campaign file, an NC program.

        Returns:
            What became of it, a sentence.

        Raises:
            InputError: It cannot be used; nothing has changed.
        """
        plain = Path(name).name
        if len(data) > LARGEST:
            raise InputError(f"{plain}: {len(data) / 1e6:.0f} MB; allowed: up to {LARGEST / 1e6:.0f} MB")
        if plain in ("", ".", ".."):
            raise InputError(f"{name!r} is no name of a file")
        path = self._drop / plain
        path.write_bytes(data)
        try:
            if path.suffix.lower() == ".toml":
                if self.existing:
                    raise InputError(f"{plain}: the campaign is there already; allowed: traces and recordings of it")
                return self._drop_toml(path)
            self._machine()
            if path.suffix.lower() in PROGRAMS:
                return self._drop_program(path)
            if self.instrument == LogTest.instrument:
                return self._drop_log(path)
            if self.instrument == SphereReading.instrument:
                return self._drop_motion(path)
            if looks_like_xml(path):
                return self._drop_b5r(path)
            return self._drop_trace(path)
        except InputError as error:
            raise InputError(self.plain(error)) from None

    def _drop_toml(self, path: Path) -> str:
        data = parse(path)
        if "drive" in data:
            self._put_machine(read_text(path))
            self.template = None
            return f"{path.name}: the machine is {self._machine().name}."
        if "test" not in data:
            raise InputError(f"{path.name}: has neither drives nor tests; allowed: a machine file or a campaign.toml")
        tables = data["test"] if isinstance(data["test"], list) else []
        planned = [{k: v for k, v in t.items() if k != "trace"} for t in tables if isinstance(t, dict)]
        self.add_tests([t for t in planned if t.get("kind") != "log"])
        return f"{path.name}: {len(planned)} tests. Drop their traces."

    def _drop_program(self, path: Path) -> str:
        name = test_name(path)
        if name not in [t["name"] for t in self.tests]:
            raise InputError(
                f"{path.name}: no test is called {name!r}; allowed: a program that is named as its test, "
                f"{', '.join(t['name'] for t in self.tests) or 'of which there is none yet'}"
            )
        kept = self.folder / "programs" / path.name
        kept.parent.mkdir(exist_ok=True)
        shutil.copyfile(path, kept)
        keys = {"program": f"programs/{path.name}"}
        try:
            self._edit(lambda document: _named_table(document, name).update(keys))
        except InputError:
            kept.unlink()
            raise
        return f"{path.name}: the program that ran in {name}."

    def _drop_b5r(self, path: Path) -> str:
        read = read_features(self.folder, [path])
        made = import_traces(self.folder, [path], force=self._force, check=False) if self.tests else []
        import_features(self.folder, [path], self._force)
        for trace in made:
            self._keep(path, trace)
        said = f"{path.name}: {sum(len(i.features) for i in read.values())} features"
        recorded = read_recorded(path)
        if made or not recorded.runs:
            return f"{said}; runs of {', '.join(t.test.name for t in made) or 'no test'}."
        runs = " and ".join(r.direction for r in recorded.runs)
        keys = {"kind": "circular"} | recorded.keys
        self.files[path.name] = Dropped(path, f"runs {runs}, which become a test each", keys)
        return f"{said}; how were its runs made?"

    def _drop_trace(self, path: Path) -> str:
        table = read_any(path, Options())
        dropped = Dropped(path, f"{len(table.lines)} rows; {table.columns}", guessed_keys(path, table.header))
        self.files[path.name] = dropped
        name = test_name(path)
        if name in [t["name"] for t in self.tests]:
            self.bring_in(path.name, name)
            return f"{path.name}: the trace of {name}."
        log = " If the control recorded it, choose the control in step 2." if self._is_log(table) else ""
        return f"{path.name}: which test is it?{log}"

    def _is_log(self, table: Table) -> bool:
        """Whether the header of a file names commands of axes."""
        try:
            return bool(columns_of(table, self._machine().chain, (), Options()))
        except InputError:
            return False

    def _drop_motion(self, path: Path) -> str:
        """A recording of an R-test, whose file is named as its test."""
        name, planned = test_name(path), [t["name"] for t in self.tests]
        if name not in planned:
            raise InputError(
                f"{path.name}: no test is called {name!r}; allowed: a file that is named as its test, "
                f"{', '.join(planned) or 'of which there is none yet: take over a plan first'}"
            )
        made = import_points(self.folder, path, name, force=self._force)
        columns = ", ".join(f"{c.name} in {c.unit}" for c in made.columns)
        self.files[path.name] = Dropped(path, columns, {}, name, made.notes, made.questions)
        return f"{path.name}: the recording of {name}."

    def _drop_log(self, path: Path) -> str:
        table = read_any(path, Options())
        self.files[path.name] = Dropped(path, f"{len(table.lines)} rows; {table.columns}")
        self.bring_in_log(path.name)
        return f"{path.name}: the log {self.files[path.name].test}."

    def bring_in(
        self, file: str, test: str, keys: dict[str, Any] | None = None, options: Options | None = None
    ) -> list[ImportedTrace]:
        """Bring a dropped trace into the draft.

        Args:
            file: Its name.
            test: Name of its test.
            keys: Of the ``[[test]]`` table of a test that is not there yet; of each run of a ``.b5r`` file.
            options: How the file is read, where its header does not say.

        Raises:
            InputError: What is missing or wrong; nothing has changed.
        """
        dropped = self.files[file]
        if looks_like_xml(dropped.path) and keys is not None:  # each of its runs is a test, in its own direction
            keys, test = {k: v for k, v in keys.items() if k != "direction"}, ""
        try:
            made = import_traces(self.folder, [dropped.path], test or None, keys, options, self._force, check=False)
        except InputError as error:
            dropped.problem = self.plain(error)
            raise InputError(dropped.problem) from None
        for trace in made:
            self._keep(dropped.path, trace)
        return made

    def bring_in_log(self, file: str, signals: tuple[str, ...] = (), options: Options | None = None) -> ImportedLog:
        """Bring a dropped log into the draft; arguments as of :meth:`bring_in`, ``signals`` as ``mjsim import`` takes
        them.
        """
        dropped = self.files[file]
        try:
            made = import_log(self.folder, dropped.path, None, signals, None, options, self._force)
        except InputError as error:
            dropped.problem = self.plain(error)
            raise InputError(dropped.problem) from None
        columns = ", ".join(f"{c.axis} {c.signal} in {c.unit}".strip() for c in made.columns)
        dropped.columns, dropped.test, dropped.problem = f"{made.samples} samples; {columns}", made.test, ""
        dropped.notes, dropped.questions = made.notes, made.questions
        return made

    def _keep(self, path: Path, made: ImportedTrace) -> None:
        """Say of a file what was brought in of it."""
        data = made.to_json()
        words = f"{data['samples']} samples in {data['duration_s']:.1f} s, {data['min_um']:g} to {data['max_um']:g} µm"
        name = path.name if path.name not in self.files or self.files[path.name].test in ("", made.test.name) else ""
        name = name or f"{path.name} ({made.test.name})"
        kept = self.files.setdefault(name, Dropped(path))
        kept.columns, kept.test, kept.problem = f"{words} (unit in the file: {made.unit})", made.test.name, ""
        kept.notes, kept.questions = made.notes, made.questions

    # -- what comes out ------------------------------------------------------------------------------------------------

    def mistakes(self, threads: int = 2) -> list[str]:
        """What ``mjsim check`` says, a sentence each; simulates the measured tests.

        Raises:
            InputError: Nothing was measured.
        """
        result = check(self.folder, threads=threads)
        questions = [q for part in result.parts for q in part.to_json().get("questions", [])]
        return [self.plain(m.sentence) for m in result.mistakes] + [self.plain(q) for q in questions]

    def programs(self, dialect: str) -> bytes:
        """NC programs of all tests in motion, as a ZIP file.

        Args:
            dialect: Of the control, one of those that ``mjsim nc`` writes.

        Raises:
            InputError: There is no test, or an axis would leave its travel.
        """
        campaign, machine = self.campaign, self._machine()
        tests = campaign.in_motion.tests if campaign is not None else ()
        if not tests:
            raise InputError("There is no test yet; take over a plan, or drop a trace.")
        return zipped_programs(tests, NcOptions(dialect), machine=machine.name)

    def write(self, target: str) -> Path:
        """Write the campaign where the user wants it; all of it, or nothing.

        Args:
            target: A new or an empty folder.

        Returns:
            The folder.

        Raises:
            InputError: There is no test, the folder holds something already or cannot be written.
        """
        if not target.strip():
            raise InputError("The folder has no name; allowed: the path of a new or an empty folder.")
        folder = Path(target.strip()).expanduser()
        name = check_new_folder(folder, None, "campaign")
        self._machine()
        if not self.tests:
            raise InputError("The campaign has no test yet; take over a plan, or drop a trace.")
        check_writable(folder / "campaign.toml")
        contents: dict[Path, str | bytes] = {
            folder / p.relative_to(self.folder): p.read_bytes()
            for p in sorted(self.folder.rglob("*"))
            if p.is_file() and p.relative_to(self.folder).parts[0] != ".mjsim"
        }
        text = read_text(self.folder / "campaign.toml")
        document = tomlkit.parse(text)
        document["name"] = name
        contents[folder / "campaign.toml"] = tomlkit.dumps(document)
        write_all(contents)
        return folder

    def plain(self, error: object) -> str:
        """A sentence without the folder of the draft, which means nothing to the user."""
        text = str(error)
        for folder in (self.folder, self._drop):
            text = text.replace(f"{folder}/", "").replace(str(folder), "the campaign")
        return text


def guessed_keys(path: Path, header: tuple[str, ...]) -> dict[str, Any]:
    """Keys of a test from the header of its file, then from the words in the file's name; the user corrects them."""
    words = test_name(path).lower().replace("_", "-").split("-")
    out: dict[str, Any] = {}
    for kind in KINDS.values():
        begin = kind.name.split("_")[0][:4]
        if any(word.startswith(begin) for word in words):
            out["kind"] = kind.name
    for word in words:
        if word in ("ccw", "cw"):
            out["direction"] = word.upper()
        elif word.upper() in FIVE_AXIS.planes:
            out["plane"] = word.upper()
    return out | test_keys(header)


def _append(document: Any, tables: Sequence[dict[str, Any]]) -> None:
    """Put tables of tests at the end of campaign.toml."""
    if "test" not in document:
        document.append("test", tomlkit.aot())
    for table in tables:
        if len(document["test"]):
            document["test"][-1].add(tomlkit.nl())
        document["test"].append(tomlkit.item(table))


def _named_table(document: Any, name: str) -> Any:
    """The table of a test."""
    return next(t for t in document["test"] if t["name"] == name)
