"""What an answer of the diagnosis was worth. One function for ideal, real and wild machines.

A row has the true answer of a campaign (``answer``) and what ``mjsim diagnose --json`` said (``result``). Of every
finding: it is *right* if it or one of its alternatives was planted. It is *there* if it is a small error that may be
named: one of a machine whose file states no limits, or one at its limit. It is *in part* there if the machine does
something like it that no catalogue has. Otherwise it is *wrong*.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

#: A cause is clear from so many times the noise of the mean of two revolutions.
CLEAR = 3.0
#: Standard deviations of half a 95 % interval.
HALF = 1.96


@dataclass(frozen=True)
class Number:
    """One true number that has an interval.

    Attributes:
        planted: It belongs to a planted cause, not to a small error.
        finding: Its interval is that of a finding, not of the calibration.
        inside: The interval holds it.
        z: (estimate - truth) over its standard deviation, ``None`` where the interval is open or has no width.
    """

    planted: bool
    finding: bool
    inside: bool
    z: float | None


@dataclass(frozen=True)
class Score:
    """An answer's worth.

    Attributes:
        row: What was scored.
        mark: ``right``, ``partly``, ``missed``, ``wrong`` or ``crash``.
        clear: For every clear, separable planted cause whether it was named.
        first: Whether the first finding is a planted cause; ``None`` where no planted cause is clear.
        wrong: Ids of the findings that are wrong.
        numbers: True numbers that have an interval.
        names: (probability, whether it is true) of every name that was given with a probability.
        findings: The same of the findings alone, without their alternatives.
        limits: (probability that it is beyond its limit, whether it is) of every number with a stated limit.
        unseen: Number of clear causes that were not named, where the findings have probabilities.
    """

    row: dict
    mark: str
    clear: list[bool] = field(default_factory=list)
    first: bool | None = None
    wrong: list[str] = field(default_factory=list)
    numbers: list[Number] = field(default_factory=list)
    names: list[tuple[float, bool]] = field(default_factory=list)
    findings: list[tuple[float, bool]] = field(default_factory=list)
    limits: list[tuple[float, bool]] = field(default_factory=list)
    unseen: int = 0

    @property
    def verdict(self) -> str:
        """The true one: none, effect or unknown."""
        return self.row["answer"]["verdict"]

    @property
    def unexplained(self) -> dict | None:
        """What the diagnosis said of a cause outside the catalogue."""
        return self.row["result"]["unexplained"]


def score(row: dict) -> Score:
    """What an answer was worth."""
    if "error" in row:
        return Score(row, "crash")
    answer, found = row["answer"], row["result"]["effects"]
    planted = {e["id"]: {e["id"], *e.get("equivalent", [])} for e in answer.get("effect", [])}
    there, in_part = small_errors_at_their_limit(answer), set(answer.get("in_part", []))
    said = [set(names_of(e)) for e in found]
    wrong = [e["id"] for e, s in zip(found, said, strict=True) if not s & (planted.keys() | there | in_part)]
    clear = [
        any(e["id"] in s for s in said)
        for e, size in zip(answer.get("effect", []), sizes_over_noise(row), strict=False)
        if size >= CLEAR and not e.get("equivalent")
    ]
    probable = [
        (p, name in planted or name in there, name == e["id"])
        for e, s in zip(found, said, strict=True)
        if not s & in_part or s & (planted.keys() | there)
        for name, p in probabilities_of(e)
        if p is not None
    ]
    return Score(
        row,
        mark=_mark(row, planted, said, bool(wrong)),
        clear=clear,
        first=bool(said and said[0] & planted.keys()) if clear else None,
        wrong=wrong,
        numbers=_numbers(row),
        names=[(p, right) for p, right, _ in probable],
        findings=[(p, right) for p, right, alone in probable if alone],
        limits=_limits(row),
        unseen=clear.count(False) if any(e.get("probability") is not None for e in found) or not found else 0,
    )


def names_of(effect: dict) -> list[str]:
    """The id of a finding and those that the data cannot tell from it."""
    others = effect.get("alternatives", [])
    return [effect["id"], *(a if isinstance(a, str) else a["id"] for a in others)]


def probabilities_of(effect: dict) -> list[tuple[str, float | None]]:
    """The same with their probabilities, ``None`` where the version gives none."""
    others = [a for a in effect.get("alternatives", []) if not isinstance(a, str) and a["id"] != effect["id"]]
    return [(e["id"], e.get("probability")) for e in (effect, *others)]


def sizes_over_noise(row: dict) -> list[float]:
    """Size of every hidden signature in units of the noise of the mean of two revolutions."""
    return [size / (row["noise_um"] / np.sqrt(2.0)) for size in row["answer"].get("signature_rms_um") or []]


def limit_of(answer: dict, name: str, parameter: str) -> float | None:
    """Limit that the machine's class has for a parameter of an effect, in the parameter's unit."""
    kind, subject = name.split(".")
    limits = answer.get("tolerance", {}).get(kind, {})
    if kind == "friction":
        known = answer.get("friction_Nm", {}).get(subject)
        return limits["ratio"] * known if known and limits and parameter == "coulomb_Nm" else None
    unit = ("deg" if subject in "ABC" else "um") if parameter == "components" else parameter.rsplit("_", 1)[-1]
    return limits.get(unit)


def small_errors_at_their_limit(answer: dict) -> set[str]:
    """Ids of the small errors that may be named: all where no limits are stated, else those that reach theirs, as
    closely as a number is defined on that machine.
    """
    small = answer.get("within", [])
    if not answer.get("tolerance_stated", True):
        return {e["id"] for e in small}
    out = set()
    for e in small:
        for key, value in e.items():
            limit = limit_of(answer, e["id"], key)
            if limit is None:
                continue
            neutral = answer["friction_Nm"][e["id"][-1]] if key == "coulomb_Nm" else 0.0
            size = max(abs(w[1]) for w in value) if key == "components" else abs(value - neutral)
            if size >= (1.0 - answer.get("defined_to", 0.0)) * limit:
                out.add(e["id"])
    return out


def _mark(row: dict, planted: dict[str, set[str]], said: list[set[str]], wrong: bool) -> str:
    verdict, unexplained = row["answer"]["verdict"], row["result"]["unexplained"]
    if verdict == "none":
        outside = unexplained and not row["answer"].get("in_part")  # a wild machine does have more than the catalogue
        return "wrong" if wrong or outside else "right"
    near = {w for w in planted for s in said if w in s}
    if verdict == "unknown":
        if not unexplained:
            return "wrong" if wrong else "missed"
        return "partly" if wrong or near != set(planted) else "right"
    if wrong:
        return "wrong"
    if {w for w in planted for s in said if w in s and s <= planted[w]} == set(planted):
        return "right"
    return "partly" if near else "missed"


def _numbers(row: dict) -> list[Number]:
    """Every true number that has an interval, but those that a wild machine does not have."""
    answer, result = row["answer"], row["result"]
    planted, small = ({e["id"]: e for e in answer.get(k, [])} for k in ("effect", "within"))
    entries = {e["id"]: (e, False) for e in result.get("calibration", [])}
    entries |= {e["id"]: (e, True) for e in result["effects"]}
    out = []
    for name, (entry, finding) in entries.items():
        if (name not in planted and name not in small) or name in answer.get("undefined", []):
            continue
        true, values = planted.get(name) or small[name], entry.get("parameters") or {}
        for key, pair in (entry.get("ci95") or {}).items():
            limit = None if name in planted else limit_of(answer, name, key)
            for truth, value, low, high in _pairs(true.get(key), values.get(key), pair, key):
                vague = answer.get("defined_to", 0.0) * (limit or abs(truth))
                out.append(_number(name in planted, finding, truth, value, low, high, vague))
    return out


def _limits(row: dict) -> list[tuple[float, bool]]:
    """Of every number with a stated limit the probability that it is beyond, and whether it is. Numbers that a machine
    does not have, or has no more closely defined than that, are left out; so are those that look like what was planted.
    """
    answer = row["answer"]
    true = {e["id"]: e for e in (*answer.get("within", []), *answer.get("effect", []))}
    alike = {name for e in answer.get("effect", []) for name in e.get("equivalent", [])} - true.keys()
    out = []
    for b in row["result"].get("budget", []):
        p, limit, name = b["probability_beyond"], b["limit"], b["id"]
        if p is None or name in alike or name in answer.get("undefined", []):
            continue
        mine = true.get(name, {})
        if b["number"].startswith("order "):
            sizes = {f"order {order:g}": amplitude for order, amplitude, _ in mine.get("components", [])}
            size = abs(sizes.get(b["number"], 0.0))
        else:
            size = abs(mine.get(b["number"], b["expected"]) - b["expected"])
        if abs(size - limit) >= answer.get("defined_to", 0.0) * limit:
            out.append((p, size > limit))
    return out


def _pairs(true, value, pair, key: str):
    """(truth, estimate, low, high) of a parameter; of every wave that has an interval, its amplitude."""
    if key == "components":
        found = {round(low[0]): (low[1], high[1]) for low, high in zip(*pair, strict=True)}
        for order, amplitude, _ in true or []:
            if round(order) in found:
                yield amplitude, None, *found[round(order)]
    elif isinstance(true, (int, float)) and not key.startswith("phase"):
        yield true, value, *pair


def _number(planted: bool, finding: bool, truth: float, value, low, high, vague: float) -> Number:
    """``vague`` is how closely the number is defined: it widens the interval as a further standard deviation."""
    known = [x for x in (low, high) if x is not None]
    middle = value if isinstance(value, (int, float)) else sum(known) / len(known) if known else truth
    below = low is None or middle - np.hypot(middle - low, HALF * vague) <= truth or low <= truth
    above = high is None or truth <= middle + np.hypot(high - middle, HALF * vague) or truth <= high
    z = None
    if low is not None and high is not None and high > low:
        z = float((middle - truth) / np.hypot((high - low) / (2.0 * HALF), vague))
    return Number(planted, finding, bool(below and above), z)
