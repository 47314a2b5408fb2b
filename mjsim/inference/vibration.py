"""Vibration: lines of constant frequency in what does not repeat from one revolution to the next.

A vibration's phase is free in every test, so it is a nuisance with a size: it is looked for before everything else, in
single samples (blocks would average it away), and left out of the data while the other effects are searched. A
periodogram weighted with the reading's sensitivity to one axis (matched filter) gives frequency and axis; amplitude and
the phase in every test follow by least squares. The signal of the instrument itself may hum as well, with the mains as
a rule: that is the same wherever the machine stands, and is no vibration of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import gammaincc

from mjsim.effects.vibration import Vibration
from mjsim.inference.nuisance_fit import fit_nuisance
from mjsim.inference.problem import Problem
from mjsim.inference.samples import revolution_time
from mjsim.inference.settings import DiagnosisSettings
from mjsim.instruments.ball_bar.kinds import kind_of
from mjsim.machine.chain import Chain
from mjsim.machine.effect import Effect
from mjsim.machine.model import Machine, build
from mjsim.units import UM

#: Band that is searched: from here, Hz, to this share of the sample rate; what is slower than SLOW s is taken out
#: before.
LOWEST, HIGHEST = 2.0, 0.46
SLOW = 1.0
#: Around a peak the true line is looked for, in units of the spectral resolution: a wave whose sensitivity turns with
#: the bar has side lines one or two turns off, and whole periods per turn leave no difference between turns.
_AROUND = 7.0
#: Least mean square of a reading's sensitivity to an axis in which that axis is looked for.
_SEEN = 0.02


@dataclass(frozen=True)
class Line:
    """One vibration found.

    Attributes:
        effect: ``vibration.*`` with its phases. ci95: per parameter, file units. alternatives: ids that do as well.
        gain: fall of the squared residuals in units of the noise at that frequency.
    """

    effect: Vibration = field(repr=False)
    ci95: dict
    alternatives: tuple[str, ...]
    gain: float


@dataclass(frozen=True)
class Hum:
    """A wave that the instrument's signal has of its own, alike wherever the machine stands.

    Attributes:
        amplitude: m.
        frequency: Hz.
        phases: At the program's start, rad by name of the recording.
        alternatives: ids of vibrations that would look the same in these tests.
    """

    amplitude: float
    frequency: float
    phases: dict[str, float]
    alternatives: tuple[str, ...] = ()

    def to_json(self) -> dict:
        """As in the JSON of ``mjsim diagnose``."""
        return {
            "amplitude_um": round(self.amplitude / UM, 4),
            "frequency_Hz": round(self.frequency, 4),
            "alternatives": list(self.alternatives),
        }


@dataclass(frozen=True)
class Record:
    """One test's residual in single samples.

    Attributes:
        name: Of its recording.
        time: From the program's start, (n,) s.
        x: (n,) m, with bad samples at 0.
        weight: Sensitivities to the linear axes, and behind them that to the instrument's signal; 0 at bad samples,
            (n, 4).
        noise: Power per sample over the frequencies of the spectrum of ``x``, m².
        rate: Samples per second, Hz.
    """

    name: str
    time: np.ndarray
    x: np.ndarray
    weight: np.ndarray
    noise: np.ndarray
    rate: float

    def noise_at(self, frequency: np.ndarray | float) -> np.ndarray:
        """Noise power per sample at frequencies in Hz, m²."""
        return np.asarray(np.interp(frequency, np.fft.rfftfreq(2 * (len(self.noise) - 1), 1.0 / self.rate), self.noise))


def find(problem: Problem, rest: list[np.ndarray], nuisance: np.ndarray) -> Line | Hum | None:
    """The strongest vibration or hum in the residuals ``rest``, or ``None``.

    It is looked for in half-differences of revolutions, where nothing that belongs to the axes' positions is left, and
    measured in the residuals themselves.
    """
    records = records_of(problem, rest, nuisance, True)
    if not records:
        return None
    chain, settings = problem.chain, problem.settings
    frequency, chance = _strongest(records)
    if chance >= settings.vibration_false_alarm:
        return None
    found = line_near(records_of(problem, rest, nuisance, False), frequency, chain, settings)
    if found is None:
        return None
    size = found.amplitude if isinstance(found, Hum) else found.effect.si("amplitude_um")
    return found if size > settings.vibration_size * problem.noise.rms else None


def records_of(problem: Problem, rest: list[np.ndarray], nuisance: np.ndarray, repeats: bool) -> list[Record]:
    out = []
    for k, s in enumerate(problem.samples):
        shift, dt = problem.shift(k, nuisance), float(np.median(np.diff(s.time)))
        time, valid = s.time - shift, s.valid
        axes = [s.sample_all(problem.sensitivity[k].axes[:, i], shift) for i in range(len(problem.chain.linear))]
        weight = np.column_stack([*axes, np.ones(len(time))])
        x = np.where(valid, rest[k], 0.0)
        if repeats:
            if not kind_of(s.test).repeats(s.test):
                continue
            lag = round(revolution_time(s.test) / dt)
            n = len(x) - lag
            valid = valid[:n] & valid[lag:]
            x, time, weight = np.where(valid, 0.5 * (x[lag:] - x[:n]), 0.0), time[:n], weight[:n]
        if valid.sum() < 400:
            continue
        x = np.where(valid, x - _slow(x, dt), 0.0)
        power = np.abs(np.fft.rfft(x)) ** 2 / valid.sum()
        width = max(5, round(1.5 * len(x) * dt)) | 1
        floor = median_filter(power, size=width, mode="nearest") / np.log(
            2.0
        )  # the median of an exponential is ln 2 of its mean
        out.append(
            Record(s.test.recording, time, x, np.where(valid[:, None], weight, 0.0), np.maximum(floor, 1e-18), 1.0 / dt)
        )
    return out


def _slow(x: np.ndarray, dt: float) -> np.ndarray:
    """What changes in more than ``SLOW`` s. The window's side lobes are below 0.2 %, so it takes nothing off a
    vibration: a plain mean over 1 s takes up to 0.5 % off it, or adds that much.
    """
    window = np.blackman(max(5, round(3.0 * SLOW / dt)) | 1)
    return np.convolve(x, window / window.sum(), mode="same")


def _strongest(records: list[Record]) -> tuple[float, float]:
    """Frequency and chance of the strongest line over all tests, axes and the instrument's signal.

    Each test's power over its noise is an exponential deviate, their sum a gamma one.
    """
    size = 2 ** int(np.ceil(np.log2(2 * max(len(r.x) for r in records))))
    rate = max(r.rate for r in records)
    f = np.fft.rfftfreq(size, 1.0 / rate)
    band = (f > LOWEST) & (f < HIGHEST * rate)
    best = (0.0, 1.0)
    ways = records[0].weight.shape[1]
    for i in range(ways):
        total, tests = np.zeros(len(f)), 0
        for r in records:
            if not _shows(r, i):
                continue
            own = float(r.weight[:, i] @ r.weight[:, i])
            mine = f if r.rate == rate else np.fft.rfftfreq(size, 1.0 / r.rate)
            power = np.abs(np.fft.rfft(r.x * r.weight[:, i], size)) ** 2 / (r.noise_at(mine) * own)
            if mine is not f:  # traces of one campaign may differ in their rate
                power = np.interp(f, mine, np.where(mine < HIGHEST * r.rate, power, 0.0), right=0.0)
            total += power
            tests += 1
        if not tests:
            continue
        total = np.where(band, total, 0.0)
        at = int(np.argmax(total))
        chance = float(gammaincc(tests, total[at]) * band.sum() * ways)
        if chance < best[1]:
            best = (float(f[at]), chance)
    return best


def _shows(r: Record, i: int) -> bool:
    """Whether a test sees an axis: otherwise the noise looks like a large wave of it."""
    return float(r.weight[:, i] @ r.weight[:, i]) >= _SEEN * len(r.x)


def amplitude_of(r: Record, frequency: float, i: int) -> tuple[complex, float]:
    """Complex amplitude c (a vibration |c| sin(ωt + arg c)) of one test by least squares, and its information, 1/m²."""
    w = r.weight[:, i]
    turn = 2.0 * np.pi * frequency * r.time
    columns = np.column_stack([w * np.sin(turn), w * np.cos(turn)])
    normal = columns.T @ columns
    scale = np.trace(normal)
    if scale < 1e-9:
        return 0j, 0.0
    c = np.linalg.solve(normal + np.eye(2) * 1e-9 * scale, columns.T @ r.x)
    return complex(c[0], c[1]), 0.5 * scale / float(r.noise_at(frequency))


def phases_of(records: list[Record], frequency: float, i: int) -> dict[str, float]:
    """Phase of a wave of the ``i``-th axis in every recording, rad by name: readings of one share it."""
    sums: dict[str, complex] = {}
    for r in records:
        wave, information = amplitude_of(r, frequency, i)
        sums[r.name] = sums.get(r.name, 0j) + information * wave
    return {name: float(np.angle(wave)) for name, wave in sums.items()}


def _common(records: list[Record], frequency: float, i: int) -> tuple[float, float, float]:
    """Gain with one amplitude for all tests, that amplitude (m), and the gain with an amplitude for each."""
    pairs = [amplitude_of(r, frequency, i) for r in records]
    info = sum(v for _, v in pairs)
    if info == 0.0:
        return 0.0, 0.0, 0.0
    a = sum(v * abs(c) for c, v in pairs) / info
    return a * a * info, a, sum(v * abs(c) ** 2 for c, v in pairs)


def line_near(records: list[Record], frequency: float, chain: Chain, settings: DiagnosisSettings) -> Line | Hum | None:
    """The line near ``frequency``: of the axis that explains most, or a hum where no axis explains clearly more.

    ``None`` where the tests do not agree on one amplitude.
    """
    signal = len(chain.linear)
    seen = [i for i in range(signal + 1) if any(_shows(r, i) for r in records)]
    fits = {i: _refined(records, frequency, i) for i in seen}
    best = max(fits, key=lambda i: fits[i][1])
    alike = [i for i in fits if fits[i][1] > fits[best][1] - settings.indistinguishable]
    best = signal if signal in alike else best
    f, gain, amplitude, free = fits[best]
    if gain < settings.vibration_common * free or amplitude == 0.0:
        return None
    phases = phases_of(records, f, best)
    others = tuple(f"vibration.{chain.linear[i]}" for i in alike if i not in (best, signal))
    if best == signal:
        return Hum(amplitude, f, phases, others)
    info = np.array([amplitude_of(r, f, best)[1] for r in records])
    spread = float(info @ [np.var(r.time) for r in records])
    effect = Vibration(chain.linear[best], amplitude_um=amplitude / UM, frequency_Hz=f).with_phases(phases)
    size, sd_a, sd_f = amplitude / UM, 1.0 / UM / np.sqrt(info.sum()), 1.0 / (2.0 * np.pi * amplitude * np.sqrt(spread))
    ci = {
        "amplitude_um": [max(0.0, size - 1.96 * sd_a), size + 1.96 * sd_a],
        "frequency_Hz": [f - 1.96 * sd_f, f + 1.96 * sd_f],
    }
    return Line(effect, ci, others, gain)


def _refined(records: list[Record], frequency: float, i: int) -> tuple[float, float, float, float]:
    """Best frequency nearby for one axis, with :func:`_common` there."""
    from scipy.optimize import (
        minimize_scalar,
    )  # takes longer to load than a test to simulate, and most campaigns have no line

    width = 1.0 / max(r.time[-1] - r.time[0] for r in records)
    near = frequency + np.arange(-_AROUND, _AROUND + 0.01, 0.125) * width
    coarse = float(near[int(np.argmax([_common(records, f, i)[0] for f in near]))])
    span = 0.2 * width
    found = minimize_scalar(
        lambda f: -_common(records, f, i)[0], bounds=(coarse - span, coarse + span), method="bounded"
    )
    return (float(found.x), *_common(records, float(found.x), i))


@dataclass(frozen=True)
class Separated:
    """A problem whose data have no vibrations in them.

    Attributes:
        problem: With all vibrations and hums left out of the data; the noise is estimated without them.
        machine: Without vibrations.
        lines: What was left out: what was found, and what the machine as given has, with the phases of the tests.
        hums: What was left out as the instrument's own.
    """

    problem: Problem
    machine: Machine
    lines: tuple[Line, ...]
    hums: tuple[Hum, ...] = ()


def separate(problem: Problem, machine: Machine) -> Separated:
    """Take vibrations out of the data: those of ``machine``, with the phases of the tests, and what else is found.

    A hum of the instrument goes as well.
    """
    rigid = without_vibrations(machine)
    readings = problem.readings(build(rigid))
    nuisance = fit_nuisance(problem, readings)
    lines: list[Line] = []
    hums: list[Hum] = []
    data = problem
    while len(lines) + len(hums) < problem.settings.most_vibrations:
        found = find(data, data.sample_residuals(readings, nuisance), nuisance)
        if isinstance(found, Hum) and not any(_near(found.frequency, h.frequency) for h in hums):
            hums.append(found)
        elif isinstance(found, Line) and not any(_same(found.effect, line.effect) for line in lines):
            lines.append(found)
        else:
            break
        data = _without(problem, [*(line.effect for line in lines), *hums], nuisance)
    left = [e for e in machine.effects if e.kind == "vibration" and not any(_same(e, line.effect) for line in lines)]
    if left:
        weak = phased(data, replace(rigid, effects=(*rigid.effects, *left)), readings, nuisance)
        lines += [Line(e, {}, (), 0.0) for e in weak.effects if isinstance(e, Vibration)]
        data = _without(problem, [*(line.effect for line in lines), *hums], nuisance)
    return Separated(data, rigid, tuple(lines), tuple(hums))


def without_vibrations(machine: Machine) -> Machine:
    """The machine without its vibrations."""
    return replace(machine, effects=tuple(e for e in machine.effects if e.kind != "vibration"))


def is_news(line: Line, machine: Machine) -> bool:
    """Whether ``machine`` lacks this vibration, or has it at another size (outside the interval and by more than a
    tenth).
    """
    for e in machine.effects:
        if e.kind == "vibration" and _same(e, line.effect):
            a, b = e.values["amplitude_um"], line.effect.values["amplitude_um"]
            return (
                bool(line.ci95)
                and abs(a - b) > 0.1 * b
                and not line.ci95["amplitude_um"][0] <= a <= line.ci95["amplitude_um"][1]
            )
    return True


def _same(a: Effect, b: Effect) -> bool:
    return a.subject == b.subject and _near(a.values["frequency_Hz"], b.values["frequency_Hz"])


def _near(a: float, b: float) -> bool:
    """Whether two frequencies in Hz are one."""
    return abs(a - b) < 0.1


def _without(problem: Problem, waves: Sequence[Vibration | Hum], nuisance: np.ndarray) -> Problem:
    """The problem with vibrations and hums left out of its data."""

    def part(k: int) -> np.ndarray:
        shift = problem.shift(k, nuisance)
        parts = (_wave(problem, k, wave, shift) for wave in waves)
        return sum(parts, np.zeros(len(problem.samples[k].time)))

    return problem.without([part(k) for k in range(len(problem.samples))])


def phased(
    problem: Problem, machine: Machine, readings: list[np.ndarray] | None = None, nuisance: np.ndarray | None = None
) -> Machine:
    """``machine`` with the phases that its vibrations have in the measured tests; see :func:`phased_at`."""
    return phased_at(problem, machine, readings, nuisance)[0]


def phased_at(
    problem: Problem, machine: Machine, readings: list[np.ndarray] | None = None, nuisance: np.ndarray | None = None
) -> tuple[Machine, np.ndarray | None]:
    """``machine`` with the phases that its vibrations have in the measured tests, and the nuisances that these phases
    belong to: at a trigger one period off they look nearly as good. ``None`` where nothing vibrates.

    Args:
        problem: The measured tests.
        machine: The machine.
        readings: Simulated ones of the machine without vibrations, one per test, m; made where missing.
        nuisance: Fitted to ``readings``, (problem.nuisances.size,); where missing, it is fitted, and again without
            the vibrations, which disturb the triggers.
    """
    waves = _vibrations(machine)
    if not waves:
        return machine, None
    if readings is None:
        readings = problem.readings(build(without_vibrations(machine)))
    if nuisance is None:
        nuisance = fit_nuisance(problem, readings)
        found = _with_phases(problem, waves, readings, nuisance)
        nuisance = fit_nuisance(_without(problem, found, nuisance), readings)
    for effect in _with_phases(problem, waves, readings, nuisance):
        machine = machine.with_effect(effect)
    return machine, nuisance


def at_own_noise(problem: Problem, machine: Machine, nuisance: np.ndarray) -> Problem:
    """The same data with the noise that they have without the vibrations of ``machine`` (:func:`phased_at`)."""
    waves = _vibrations(machine)
    return _without(problem, waves, nuisance).restored()


def _vibrations(machine: Machine) -> list[Vibration]:
    return [e for e in machine.effects if isinstance(e, Vibration) and not e.is_neutral]


def _with_phases(
    problem: Problem, waves: list[Vibration], readings: list[np.ndarray], nuisance: np.ndarray
) -> list[Vibration]:
    """The vibrations with the phases that they have in every test at these triggers."""
    out = []
    rest = problem.sample_residuals(readings, nuisance)
    for effect in waves:
        records = records_of(problem, rest, nuisance, False)
        i, f = problem.chain.index(effect.subject), effect.values["frequency_Hz"]
        out.append(effect.with_phases(phases_of(records, f, i)))
        rest = [r - _wave(problem, k, out[-1], problem.shift(k, nuisance)) for k, r in enumerate(rest)]
    return out


def _wave(problem: Problem, k: int, wave: Vibration | Hum, shift: float) -> np.ndarray:
    """What a vibration or a hum adds to every sample of test ``k``, m."""
    s = problem.samples[k]
    if isinstance(wave, Hum):
        weight, frequency = wave.amplitude, wave.frequency
    else:
        along = problem.sensitivity[k].axes[:, problem.chain.index(wave.subject)]
        weight, frequency = wave.si("amplitude_um") * s.sample_all(along, shift), wave.values["frequency_Hz"]
    phase = wave.phases.get(s.test.recording, 0.0)
    return weight * np.sin(2.0 * np.pi * frequency * (s.time - shift) + phase)
