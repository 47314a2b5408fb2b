"""The best next test for two explanations."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

from mjsim.inference.planning.candidates import first_round, minutes, neighbours, reachable
from mjsim.inference.planning.separation import Separation, Separator
from mjsim.inference.settings import PLAN, PlanSettings
from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.instruments.base import table_of
from mjsim.progress import Progress, silent


def worth(s: Separation, settings: PlanSettings = PLAN) -> tuple[float, float]:
    """Sort key: tests that decide by deviance per minute of machine time, before tests that do not by deviance."""
    if s.deviance < settings.decisive:
        return 0.0, s.deviance
    return 1.0, min(s.deviance, settings.certain) / minutes(s.test, settings.handling)


def choose(
    separator: Separator,
    tests: tuple[BallBarTest, ...],
    threads: int = 2,
    progress: Progress = silent,
    settings: PlanSettings = PLAN,
) -> list[Separation]:
    """Candidate tests, best first: a coarse round over everything, then conditions varied around the best ones.

    Args:
        separator: Of the two explanations.
        tests: The campaign's tests (bar, height of the table ball, what the axes are known to reach).
        threads: Tests that are looked at side by side.
        progress: Called as work gets on.
        settings: What decides.
    """
    seen: dict[str, Separation] = {}

    def evaluate(candidates: Iterable[BallBarTest], stage: str) -> None:
        fresh = {key(t): t for t in candidates if key(t) not in seen and reachable(t, tests)}
        for n, s in enumerate(pool.map(separator.of, fresh.values())):
            seen[key(s.test)] = s
            if progress:
                progress(stage, n + 1, len(fresh))

    def key(t: BallBarTest) -> str:
        return str({k: v for k, v in table_of(t).items() if k not in ("name", "setup")})

    def ranked() -> list[Separation]:
        return sorted(seen.values(), key=lambda s: worth(s, settings), reverse=True)

    with ThreadPoolExecutor(threads) as pool:
        evaluate(first_round(tests), "planning: all kinds of tests")
        for _ in range(settings.rounds):
            best = ranked()[: settings.refined]
            evaluate([n for s in best for n in neighbours(s.test)], "planning: around the best")
    return ranked()
