"""The tests of a new campaign: those that tell most of a machine in the time that there is, and what they leave open.

Nothing was measured yet. Every effect of the catalogue may be there in its typical size: that is its prior. A possible
test is linear in the effects, the data sheet, the length of the bar, the balls' places and the trigger. What it tells
is the fall of the entropy of the effects (Bayesian D-optimality: Chaloner and Verdinelli, Statistical Science 10, 1995,
eq. 5), with all the rest unknown within its priors. The tests are chosen one after the other, each for most of this per
minute.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mjsim.effects import registry
from mjsim.errors import InputError
from mjsim.inference.data_sheet import sheet_of
from mjsim.inference.effect_vector import EffectVector
from mjsim.inference.linearisation import Linearisation
from mjsim.inference.noise import usual_noise
from mjsim.inference.nuisance import TRIGGER, set_up_columns, set_up_sizes
from mjsim.inference.planning.candidates import motions_at, reachable, renamed
from mjsim.inference.planning.next_test import typical
from mjsim.inference.planning.separation import Unmeasured, whitened
from mjsim.inference.problem import sheet_grid, sheet_plants
from mjsim.inference.samples import BLOCKS, GRID_STEPS
from mjsim.inference.settings import PLAN
from mjsim.instruments.ball_bar.kinds import KINDS, kind_of
from mjsim.instruments.ball_bar.kinds.base import place_name
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.ball_bar.program import Program
from mjsim.instruments.base import table_of
from mjsim.instruments.r_test.measurement import USUAL_NOISE
from mjsim.machine.model import Machine, build
from mjsim.progress import Progress, silent
from mjsim.simulation.axes import AxesMotion, motions_of
from mjsim.threads import Workers, one_blas_thread
from mjsim.units import MM

#: Time from one test to the next where nobody touches a ball, s (assumed).
NEXT_TEST = 20.0
#: Feed of the tests, m/s; bar and height of the table ball, m: those of a new campaign's template.
FEED, BAR, HEIGHT = 1000 * MM / 60.0, 100 * MM, 155 * MM
#: X of the sphere of an R-test, m.
SPHERE = 100 * MM
#: Standard deviations of an effect that its typical size has to be to show.
_SHOWN = 3.0


@dataclass(frozen=True)
class CampaignPlan:
    """Tests of a new campaign, and what they would tell of this machine.

    Attributes:
        tests: In the order of measuring; those of one set-up follow each other.
        minutes: Machine time, with the handling of balls and bar.
        told: Ids of the effects that a typical size of would be told from all others.
        alike: Ids of effects that would show, each with the one that looks most like it.
        hidden: Ids of effects that would not show.
    """

    tests: tuple[BallBarTest, ...]
    minutes: float
    told: tuple[str, ...]
    alike: dict[str, str]
    hidden: tuple[str, ...]

    def to_json(self) -> dict:
        """Plain data, as ``mjsim plan --new --json`` prints it."""
        return {
            "minutes": round(self.minutes, 1),
            "tests": [{**table_of(t), "started_s": round(t.started, 1)} for t in self.tests],
            "told": list(self.told),
            "alike": [{"id": i, "like": other} for i, other in self.alike.items()],
            "hidden": list(self.hidden),
        }


def told_sentences(data: dict) -> list[str]:
    """What a plan of a new campaign can and cannot tell, a sentence each.

    Args:
        data: JSON of the plan.
    """
    told = _by_kind(data["told"]) or "nothing"
    alike = ", ".join(f"{a['id']} ({a['like']})" for a in data["alike"])
    hidden = _by_kind(data["hidden"])
    out = [f"Tells from everything else, in its typical size: {told}."]
    if alike:
        out.append(f"Shows, but may be taken for what stands in brackets: {alike}.")
    if hidden:
        out.append(f"Does not show: {hidden}.")
    out.append("Periodic errors are not judged here, because their orders are not known before: pitch errors, torque "
               "ripple, vibration.")  # fmt: skip
    return out


def _by_kind(ids: Sequence[str]) -> str:
    """Ids of effects, each kind with all its subjects."""
    kinds: dict[str, list[str]] = {}
    for kind, _, subject in (i.partition(".") for i in ids):
        kinds.setdefault(kind, []).append(subject)
    return "; ".join(f"{kind} {', '.join(subjects)}" for kind, subjects in kinds.items())


class CampaignPlanner:
    """Plans campaigns of one machine; what the possible tests show is computed once.

    Args:
        machine: As its file says.
        threads: Tests that are looked at side by side.
        progress: Called as work gets on.
        effects: What the tests may show; without it everything of the catalogue that has a typical size.
        tests: That are looked at, all of one instrument, of an R-test one reading each; without it all ball-bar tests
            that the machine can run.

    Raises:
        InputError: A ball bar runs no test on this machine.
    """

    def __init__(
        self,
        machine: Machine,
        threads: int = 2,
        progress: Progress = silent,
        effects: Sequence[EffectVector] | None = None,
        tests: Sequence[BallBarTest] | None = None,
    ) -> None:
        self.machine, self._workers = machine, Workers(threads)
        self._plant = build(machine)
        self._sheet = sheet_of(machine)
        self._plants = sheet_plants(machine, machine.chain.letters)
        self._effects = _typical_effects(machine) if effects is None else effects
        sizes = [len(f.vector) for f in self._effects]
        ends = np.cumsum([0, *sizes])
        self._places = {f.effect.id: slice(a, b) for f, a, b in zip(self._effects, ends, ends[1:], strict=False)}
        self._count = int(ends[-1])
        self._drives = {
            f.effect.id: build(machine.with_effect(f.effect)) for f in self._effects if not f.effect.search.quasi_static
        }
        self._told: dict[str, np.ndarray] = {}  # information of each test
        tests = list(possible_tests(machine) if tests is None else tests)
        if not tests:
            raise InputError(
                f"machine {machine.name!r} runs no ball-bar test within the usual travel; allowed: a machine with X, Y "
                f"and Z"
            )
        self._tests = tests
        sensors = bool(tests[0].component)
        self._noise = usual_noise(rms=USUAL_NOISE) if sensors else usual_noise()
        self._setup_size, self._own = set_up_sizes(tests[0])
        done = 0
        for n in range(0, len(tests), threads):
            self._add(tests[n : n + threads])
            done = min(n + threads, len(tests))
            progress("looking at possible tests", done, len(tests))

    @one_blas_thread
    def plan(self, minutes: float | None = None) -> CampaignPlan:
        """The tests that tell most in a time.

        Args:
            minutes: Machine time with handling; ``None``: as long as another test makes another effect known.

        Raises:
            InputError: The time is too short for any test.
        """
        chosen: list[BallBarTest] = []
        tests = list(self._tests)
        while True:
            if minutes is None and chosen and set(self._judge(tests)[0]) <= set(self._judge(chosen)[0]):
                break
            rest = [t for t in tests if t not in chosen]
            able = [t for t in rest if minutes is None or minutes_of([*chosen, t]) <= minutes]
            if not able:
                break
            now, spent = self._entropy(chosen), minutes_of(chosen)
            worth = [(now - self._entropy([*chosen, t])) / (minutes_of([*chosen, t]) - spent) for t in able]
            chosen.append(able[int(np.argmax(worth))])
            other = _named(kind_of(chosen[-1]).turned(chosen[-1]))
            if other.name not in [t.name for t in tests] and reachable(other):
                self._add([other])
                tests.append(other)
        if not chosen:
            least = min(minutes_of([t]) for t in tests)
            raise InputError(f"{minutes:g} min is too short for a test; allowed: {least:.1f} min or more")
        known, alike, hidden = self._judge(chosen)
        return CampaignPlan(_in_order(chosen), minutes_of(chosen), tuple(known), alike, tuple(hidden))

    # -- what a test shows ---------------------------------------------------------------------------------------------

    def _add(self, tests: Iterable[BallBarTest]) -> None:
        new = [t for t in tests if t.name not in self._told]
        self._told |= dict(zip([t.name for t in new], self._workers.map(self._information_of, new), strict=True))

    def _information_of(self, test: BallBarTest) -> np.ndarray:
        """What a test tells of effects, data sheet, instrument and set-up, its trigger unknown."""
        rows = _without_trigger(np.vstack([self._rows_of(m) for m in motions_of(test.readings, keep=2)]))
        return rows.T @ rows

    def _rows_of(self, motion: AxesMotion) -> np.ndarray:
        """Whitened derivatives of one reading by effects, data sheet, instrument, set-up and trigger."""
        sens = motion.sensitivity(self._plant, GRID_STEPS)
        linear = Linearisation(Unmeasured((motion,), (sens,)), self.machine, np.zeros(0))
        lo, hi = motion.program.measured_span
        time = motion.time[::GRID_STEPS]
        inside = np.flatnonzero((time >= lo) & (time <= hi))
        per_block = max(1, round(BLOCKS[0] / (time[1] - time[0])))
        inside = inside[: len(inside) // per_block * per_block]
        reading = motion.reading(self._plant, GRID_STEPS)
        columns = [c for f in self._effects for c in self._columns(f, motion, sens, linear, reading)]
        columns += list(sheet_grid(motion, sens, self._plant, self._plants))
        set_up = set_up_columns(motion.test, sens, np.zeros((len(time), 3)))
        first = self._setup_size
        columns += [*set_up[:, first:].T, *set_up[:, :first].T]
        columns.append(-np.gradient(reading, time) * TRIGGER)
        blocks = np.column_stack([c[inside].reshape(-1, per_block).mean(axis=1) for c in columns])
        return whitened(self._noise, blocks)

    def _columns(self, f: EffectVector, motion, sens, linear: Linearisation, reading: np.ndarray):
        """Change of the reading by each entry of an effect, m per typical size."""
        if f.effect.search.quasi_static:
            found = linear.columns(f)
            if found is not None:
                yield from found[0].T
                return
        plant = self._drives.get(f.effect.id) or build(self.machine.with_effect(f.effect))
        axis = f.effect.subject
        i = self.machine.chain.index(axis)
        change = np.zeros(len(reading))
        if motion.moves[i]:
            change = sens.axes[:, i] * motion.motor_change(axis, self._plant.axes[axis], plant.axes[axis], GRID_STEPS)
        yield change
        yield from np.zeros((len(f.vector) - 1, len(reading)))

    # -- what a set of tests tells -------------------------------------------------------------------------------------

    def _information(self, tests: list[BallBarTest]) -> np.ndarray:
        """What is known of effects, data sheet and length after some tests, (p, p) in units of their priors."""
        shared = self._count + len(self._sheet) + self._own
        out = np.eye(shared)
        for setup in dict.fromkeys(t.setup for t in tests):
            of_setup = sum(self._told[t.name] for t in tests if t.setup == setup)
            assert isinstance(of_setup, np.ndarray)
            cross = of_setup[:shared, shared:]
            places = np.eye(self._setup_size) + of_setup[shared:, shared:]
            out += of_setup[:shared, :shared] - cross @ np.linalg.solve(places, cross.T)
        return out

    def told_by(self, test: BallBarTest) -> np.ndarray:
        """What one test tells of the effects, the rest unknown within its priors, (p, p) per typical sizes."""
        known, n = self._information([test]), self._count
        cross = known[:n, n:]
        return known[:n, :n] - np.eye(n) - cross @ np.linalg.solve(known[n:, n:], cross.T)

    def _entropy(self, tests: list[BallBarTest]) -> float:
        """Entropy of the effects after some tests, nats, but for a constant."""
        known = self._information(tests)  # the determinant of a block of the inverse, without the inverse
        rest = known[self._count :, self._count :]
        return 0.5 * float(np.linalg.slogdet(rest)[1] - np.linalg.slogdet(known)[1])

    def _judge(self, tests: list[BallBarTest]) -> tuple[list[str], dict[str, str], list[str]]:
        """Effects that are told from all others, those that look like another one, and those that do not show."""
        known = self._information(tests)
        left = np.linalg.inv(known)
        deviation, alone = np.sqrt(np.diag(left)), self._deviation_alone(known)
        told, alike, hidden = [], {}, []
        for effect_id, place in self._places.items():
            first = place.start
            if _SHOWN * alone[first] > 1.0:
                hidden.append(effect_id)
            elif _SHOWN * deviation[first] < 1.0:
                told.append(effect_id)
            else:
                alike[effect_id] = self._like(effect_id, left, deviation)
        return told, alike, hidden

    def _deviation_alone(self, known: np.ndarray) -> np.ndarray:
        """Standard deviation of each effect if there were no other one, (effects,)."""
        n = self._count
        sheet, cross = known[n:, n:], known[n:, :n]
        return 1.0 / np.sqrt(np.diag(known)[:n] - np.einsum("ij,ij->j", cross, np.linalg.solve(sheet, cross)))

    def _like(self, effect_id: str, left: np.ndarray, deviation: np.ndarray) -> str:
        """What an effect is told from least: another effect, or a number of the data sheet."""
        first = self._places[effect_id].start
        correlation = np.abs(left[first] / (deviation[first] * deviation))
        correlation[self._places[effect_id]] = 0.0
        at = int(np.argmax(correlation[: self._count + len(self._sheet)]))
        if at >= self._count:
            return f"data sheet {self._sheet[at - self._count].label}"
        return next(i for i, place in self._places.items() if place.start <= at < place.stop)


def _without_trigger(rows: np.ndarray) -> np.ndarray:
    """Rows of one test with what its trigger can take up left out; the trigger is the last column, in its prior's
    standard deviations.
    """
    trigger = rows[:, -1]
    share = 1.0 - 1.0 / np.sqrt(1.0 + trigger @ trigger)
    along = trigger / max(float(np.linalg.norm(trigger)), 1e-300)
    return rows[:, :-1] - share * np.outer(along, along @ rows[:, :-1])


def _typical_effects(machine: Machine) -> list[EffectVector]:
    """Every effect of the catalogue that has a typical size, and that the machine file lacks."""
    out = []
    for effect_id in registry.all_ids(machine.chain):
        cls, _ = registry.effect_class(effect_id, machine.chain)
        if machine.effect(effect_id) is not None or (cls.search.within_tolerance and cls.kind not in machine.tolerance):
            continue
        try:
            out.append(typical(effect_id, machine.chain))
        except InputError:  # its orders are free
            continue
    return out


def possible_tests(machine: Machine) -> Iterator[BallBarTest]:
    """What the machine can run, of every kind."""
    for kind in KINDS.values():
        if kind.cannot(machine.chain):
            continue
        for test in kind.proposals(machine.chain, BAR, HEIGHT):
            named = _named(replace(test, feed=FEED))
            if not kind.out_of_reach(named) and reachable(named):
                yield named


def possible_motions(machine: Machine) -> Iterator[BallBarTest]:
    """R-tests that the machine can run, one reading of each: every rotary axis alone, and two together."""
    for test in motions_at(machine.chain, (SPHERE, 0.0, HEIGHT)):
        named = _named(replace(test, feed=FEED))
        if not kind_of(named).out_of_reach(named) and reachable(named):
            yield named


def _named(test: BallBarTest) -> BallBarTest:
    """A test named by what it is; tests with the balls in one place have one set-up."""
    return renamed(test, kind_of(test).short_name(test), place_name(test))


def minutes_of(tests: Iterable[BallBarTest]) -> float:
    """Machine time of some tests: balls are mounted once for each set-up."""
    tests = list(tests)
    setups = len({t.setup for t in tests})
    driven = sum(Program(t).duration for t in tests)
    return (driven + PLAN.handling * setups + NEXT_TEST * (len(tests) - setups)) / 60.0


def _in_order(tests: list[BallBarTest]) -> tuple[BallBarTest, ...]:
    """The tests set-up by set-up, with the time on the clock at which each begins."""
    out: list[BallBarTest] = []
    clock = 0.0
    for setup in dict.fromkeys(t.setup for t in tests):
        clock += PLAN.handling
        for test in (t for t in tests if t.setup == setup):
            out.append(replace(test, started=round(clock, 0)))
            clock += Program(test).duration + NEXT_TEST
    return tuple(out)
