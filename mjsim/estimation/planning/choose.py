"""The best next test for two explanations."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

from mjsim.ballbar.measurement import BallBarTest
from mjsim.campaign.files import test_table
from mjsim.estimation.planning.candidates import first_round, minutes, neighbours, reachable
from mjsim.estimation.planning.separation import Separation, Separator
from mjsim.progress import Progress, silent

#: Deviance at which a test decides, and beyond which more is not worth a longer test.
ENOUGH, PLENTY = 40.0, 400.0
_BEST, _ROUNDS = 2, 2


def worth(s: Separation) -> tuple[float, float]:
    """Sort key: tests that decide by deviance per minute of machine time, before tests that do not by deviance."""
    decides = s.deviance >= ENOUGH
    return (1.0, min(s.deviance, PLENTY) / minutes(s.test)) if decides else (0.0, s.deviance)


def choose(
    separator: Separator, tests: tuple[BallBarTest, ...], threads: int = 2, progress: Progress = silent
) -> list[Separation]:
    """Candidate tests, best first: a coarse round over everything, then conditions varied around the best ones.

    Args:
        tests: the campaign's tests (bar, height of the table ball, what the axes are known to reach).
    """
    seen: dict[str, Separation] = {}

    def evaluate(candidates: Iterable[BallBarTest], stage: str) -> None:
        fresh = {key(t): t for t in candidates if key(t) not in seen and reachable(t, tests)}
        for n, s in enumerate(pool.map(separator.of, fresh.values())):
            seen[key(s.test)] = s
            if progress:
                progress(stage, n + 1, len(fresh))

    def key(t: BallBarTest) -> str:
        return str({k: v for k, v in test_table(t).items() if k not in ("name", "setup")})

    with ThreadPoolExecutor(threads) as pool:
        evaluate(first_round(tests), "planning: all kinds of tests")
        for _ in range(_ROUNDS):
            best = sorted(seen.values(), key=worth, reverse=True)[:_BEST]
            evaluate([n for s in best for n in neighbours(s.test)], "planning: around the best")
    return sorted(seen.values(), key=worth, reverse=True)
