"""A measurement campaign with a known answer: its description and the folder that a user would bring."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit

from . import equivalents, measurement, real_machines, simulate
from .machines import by_id, nominal, true_machine, with_hidden
from .programs import Program
from .scaling import scaled_to
from .signatures import bench
from .unlisted import Unlisted

Cause = dict | Unlisted


@dataclass(frozen=True)
class Case:
    """One campaign to generate.

    Attributes:
        name: folder name. machine: name of a nominal machine. tests: ``[[test]]`` tables.
        hidden: catalogue effects (tables as in machine.toml) and unlisted causes that the user's model lacks.
        target_um: per hidden cause the signature's RMS after set-up errors to scale it to; None leaves it as it is.
            Empty: none is scaled.
        outliers, gaps: knocks and missing stretches per campaign. noise_um: RMS of a sample. seed: of everything drawn.
        category, half: for the bank.
        within: small errors of a real machine, tables as in machine.toml. tolerance_stated: whether the machine file
            has limits for them. volumetric_stated: whether it has them for angular errors and axial error motions too.
    """

    name: str
    machine: str
    tests: tuple[dict, ...]
    hidden: tuple[Cause, ...] = ()
    target_um: tuple[float | None, ...] = ()
    outliers: int = 0
    gaps: int = 0
    noise_um: float = measurement.NOISE
    seed: int = 0
    category: str = ""
    half: str = "tune"
    within: tuple[dict, ...] = ()
    tolerance_stated: bool = False
    volumetric_stated: bool = False

    def catalogue(self) -> list[dict]:
        return [h for h in self.hidden if isinstance(h, dict)]

    def unlisted(self) -> tuple[Unlisted, ...]:
        return tuple(h for h in self.hidden if not isinstance(h, dict))

    def resolved(self) -> Case:
        """The same case with every hidden cause scaled to its target."""
        if not any(self.target_um):
            return self
        here = bench(self.tests, self.machine)
        causes = (h if t is None else scaled_to(here, h, t) for h, t in zip(self.hidden, self.target_um, strict=True))
        return replace(self, hidden=tuple(causes), target_um=())

    @property
    def erring(self) -> bool:
        """Whether the machine errs beyond its data sheet."""
        return bool(self.hidden or self.within)

    def rng(self, stream: int) -> np.random.Generator:
        """Separate random numbers for machine (0), set-up (1), disturbances (2) and each test's noise (10 …)."""
        return np.random.default_rng([self.seed, stream])


def _true(case: Case, hidden: bool = True) -> tuple[dict, dict]:
    """The drawn drives and effects; without the hidden ones the tolerances drawn are the same."""
    causes = case.catalogue() if hidden else []
    planted = real_machines.merged([*real_machines.with_causes(list(case.within), causes), *causes])
    return true_machine(nominal(case.machine), planted, case.rng(0))


def truth(
    case: Case, test: dict, hidden: bool = True, tolerances: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Noise-free reading over a whole program, no set-up error: φ in degrees, time in s, deviation in µm.

    ``hidden=False`` leaves the hidden causes out; with ``tolerances=False`` as well it is the user's nominal machine.
    """
    case = case.resolved()
    if tolerances:
        drive, effects = _true(case, hidden)
    else:
        model = nominal(case.machine)
        drive, effects = model["drive"], with_hidden(by_id(model["effect"]), case.catalogue() if hidden else [])
    program = Program(test)
    time = np.arange(int(program.duration * measurement.SAMPLE_RATE) + 1) / measurement.SAMPLE_RATE
    phases = dict.fromkeys("XYZ", 0.0)
    deviation = simulate.reading(test, drive, effects, time, unlisted=case.unlisted() if hidden else (), phases=phases)
    return np.degrees(program.phi(time)), time, deviation * 1e6


def measure(case: Case) -> list[tuple[np.ndarray, np.ndarray]]:
    """The recorded traces, in the order of the tests: time in s and deviation in µm."""
    case = case.resolved()
    drive, effects = _true(case)
    setup = measurement.draw_setup(list(case.tests), case.seed)

    def read(k: int, instants: np.ndarray) -> np.ndarray:
        test = case.tests[k]
        angle = np.radians(test.get("spindle_deg", 0.0))  # the spindle ball's runout turns with the spindle
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        shifts = {"ball_shift": setup.table[test["setup"]], "spindle_shift": turn @ setup.spindle[test["setup"]]}
        odd = case.unlisted()
        return simulate.reading(test, drive, effects, instants, unlisted=odd, phases=setup.phases[k], **shifts)

    bar = measurement.Bar(outliers=case.outliers, gaps=case.gaps)
    windows = [Program(t).window for t in case.tests]
    return measurement.record(read, windows, setup, bar, case.noise_um, case.rng)


def answer(case: Case) -> dict:
    """What really hides, in the form of answers.toml, with signature sizes and equivalents."""
    case = case.resolved()
    out: dict = {"verdict": "unknown" if case.unlisted() else "effect" if case.hidden else "none"}
    if case.within:
        out["tolerance_stated"] = case.tolerance_stated
        out["within"] = real_machines.with_causes(list(case.within), case.catalogue())
    if not case.hidden:
        return out
    here = bench(case.tests, case.machine)
    out["signature_rms_um"] = [round(here.rms(h), 4) for h in case.hidden]
    out["tests"] = [{k: round(v, 4) for k, v in here.rms_by_test(h).items()} for h in case.hidden]
    if known := case.catalogue():
        out["effect"] = []
        for e in known:
            same = equivalents.equivalent(here, e)
            out["effect"].append({**e, **({"equivalent": same} if same else {})})
    if odd := case.unlisted():
        out["hidden"] = ", ".join(u.name for u in odd)
        out["axes"] = list(dict.fromkeys(a for u in odd for a in u.axes))
        out["variable"] = list(dict.fromkeys(v for u in odd for v in u.variable))
    return out


def write(case: Case, folder: Path | str) -> dict:
    """Writes campaign.toml, machine.toml and the traces into ``folder`` and returns the answer."""
    write_files(case, folder)
    return answer(case)


def write_files(case: Case, folder: Path | str) -> None:
    """Writes campaign.toml, machine.toml and the traces into ``folder``."""
    case, model = case.resolved(), nominal(case.machine)
    if case.tolerance_stated:
        first = {k: model[k] for k in ("name", "configuration")}
        limits = real_machines.TOLERANCE | (real_machines.VOLUMETRIC if case.volumetric_stated else {})
        model = first | {"tolerance": limits} | model
    write_folder(folder, case.name, model, list(case.tests), measure(case))


def write_folder(
    folder: Path | str,
    name: str,
    machine: dict,
    tests: list[dict],
    traces: list[tuple],
    bar: measurement.Bar = measurement.GOOD_BAR,
) -> None:
    """Writes what a user brings: campaign.toml, machine.toml and the traces (s, µm) of the tests. A bar without a gain
    error comes with a certificate that says that it has no error at all.
    """
    folder = Path(folder)
    (folder / "traces").mkdir(parents=True, exist_ok=True)
    instrument = {"kind": "ball_bar", "resolution_um": 0.1, "range_mm": 1.0, "sample_rate_Hz": measurement.SAMPLE_RATE}
    if bar.gain == 0.0:
        instrument |= {"certificate": "as generated", "gain_uncertainty_ppm": 0.0, "form_um": 0.0, "hysteresis_um": 0.0}
    head = {"name": name, "machine": "machine.toml", "instrument": instrument, "test": [dict(t) for t in tests]}
    (folder / "campaign.toml").write_text(tomlkit.dumps(head))
    (folder / "machine.toml").write_text(tomlkit.dumps(machine))
    for test, (time, deviation) in zip(tests, traces, strict=True):
        rows = "\n".join(f"{t:.3f},{d:.1f}" for t, d in zip(time, deviation, strict=True))
        (folder / test["trace"]).write_text("time_s,deviation_um\n" + rows + "\n")
