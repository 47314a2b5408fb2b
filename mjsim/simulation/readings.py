"""Readings of the multibody model, simulated or taken from the cache."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mjsim.instruments.ball_bar.measurement import BallBarTest
from mjsim.io import cache
from mjsim.machine.model import Machine, build
from mjsim.machine.plant import Plant
from mjsim.simulation.multibody import Reading, reading_of, simulate_each


def readings_of(
    machine: Machine | Plant,
    tests: Sequence[BallBarTest],
    threads: int = 2,
    done: Callable[[BallBarTest], None] | None = None,
) -> list[Reading]:
    """As :func:`mjsim.simulation.multibody.simulate_each`, of the readings alone; what the cache has is not simulated.

    Args:
        machine: Drives and effects, or a plant that is built already.
        tests: What is run.
        threads: Tests run side by side.
        done: Called after each test, for progress.
    """
    kept = cache.store()
    if kept is None:
        return simulate_each(machine, tests, reading_of, threads, done)
    plant = machine if isinstance(machine, Plant) else build(machine)
    try:
        keys = [cache.fingerprint(cache.code(), plant, test) for test in tests]
    except TypeError:  # an effect in Python
        return simulate_each(plant, tests, reading_of, threads, done)
    found = [kept.get("readings", key) for key in keys]
    out = {key: Reading(t, x) for key, t, x in zip(keys, tests, found, strict=True) if x is not None}
    if done:
        for reading in out.values():
            done(reading.test)
    left = [t for key, t in zip(keys, tests, strict=True) if key not in out]
    if left:
        new = iter(simulate_each(plant, left, reading_of, threads, done))
        for key in (k for k in keys if k not in out):
            out[key] = next(new)
            kept.put("readings", key, out[key].deviation)
    return [out[key] for key in keys]
