"""Figures of the diagnosis benchmark over many scores: rates, intervals, calibration of the probabilities."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from diagnosis_score import Number, Score, names_of, score, sizes_over_noise
from scipy.stats import beta

#: Share of the squared error of other tests that a fitted machine should predict.
_REMOVED = 0.95
#: Edges of the bins of a reliability diagram, and from which probability a finding is called certain.
BINS, CERTAIN = np.linspace(0.0, 1.0, 6), 0.95
#: A probability of 0 that comes true costs this much in the logarithmic score.
_LEAST = 1e-6


def rate(hits: int, count: int) -> str:
    """``hits/count = p % [95 % interval]`` (Clopper-Pearson)."""
    if not count:
        return "none"
    low, high = binomial_bounds(hits, count)
    return f"{hits}/{count} = {100 * hits / count:.1f} % [{100 * low:.0f}, {100 * high:.0f}]"


def binomial_bounds(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson 1934)."""
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    return low, float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0


def counts(figure: Callable[[Score], list[bool]], scores: Iterable[Score]) -> tuple[int, int]:
    """Hits and number of what a figure counts, over all scores but those of crashes."""
    each = [x for s in scores if s.mark != "crash" for x in figure(s)]
    return sum(each), len(each)


def _when(condition: Callable[[Score], bool], figure: Callable[[Score], bool]) -> Callable[[Score], list[bool]]:
    return lambda s: [bool(figure(s))] if condition(s) else []


def is_sound(s: Score) -> bool:
    """Whether nothing hides in a campaign."""
    return s.verdict == "none"


def is_unlisted(s: Score) -> bool:
    """Whether a cause hides in a campaign that is in no catalogue."""
    return s.verdict == "unknown"


def _recognised(s: Score) -> bool:
    return is_unlisted(s) and bool(s.unexplained)


def _shows(s: Score) -> bool:
    """Whether the error of other tests exceeds the noise of the mean."""
    return s.row.get("heldout_um", 0.0) >= s.row["noise_um"] / np.sqrt(2.0)


def numbers_of(s: Score) -> list[bool]:
    """For every true number that has an interval whether it lies inside."""
    return [n.inside for n in s.numbers]


false_alarms = _when(is_sound, lambda s: s.mark == "wrong")
wrong_names = _when(lambda s: not is_sound(s), lambda s: bool(s.wrong))
recognised = _when(is_unlisted, _recognised)
right_axis = _when(_recognised, lambda s: set(s.unexplained["axes"]) & set(s.row["answer"]["axes"]))
right_variable = _when(_recognised, lambda s: s.unexplained["variable"] in s.row["answer"]["variable"])
predicted = _when(lambda s: not is_unlisted(s) and _shows(s), lambda s: s.row["heldout_removed"] >= _REMOVED)
predicted_beside = _when(lambda s: is_unlisted(s) and _shows(s), lambda s: s.row["heldout_removed"] >= _REMOVED)
worse = _when(lambda s: "heldout_removed" in s.row and _shows(s), lambda s: s.row["heldout_removed"] < 0.0)

FIGURES = (
    ("false alarms on sound machines", false_alarms, "at most 1 %"),
    (
        "... right on those with six knocks and two gaps, by plans of all sorts",
        _when(lambda s: s.row["category"].endswith("knocked"), lambda s: s.mark == "right"),
        "40 of 40",
    ),
    ("separable causes of 3 times the noise of the mean, named", lambda s: s.clear, "97 %; wild 90 %"),
    ("... campaigns that name a planted cause first", _when(lambda s: bool(s.clear), lambda s: s.first), "wild 90 %"),
    ("campaigns with a wrong confident name, of the others", wrong_names, "at most 1 %"),
    ("causes outside the catalogue recognised", recognised, "95 %"),
    ("... on the right axis (of those recognised)", right_axis, ""),
    ("... with the right variable (of those recognised)", right_variable, ""),
    ("... with no name that is not there", _when(is_unlisted, lambda s: not s.wrong), ""),
    ("0.95 or more of the error of other tests predicted", predicted, "95 %"),
    ("... on machines with a cause outside the catalogue", predicted_beside, ""),
    ("fitted machines that predict other tests worse than the given one", worse, "none"),
    ("answered in full", lambda s: [s.mark == "right"], ""),
)


def median_predicted(scores: Iterable[Score]) -> str:
    """Median share of the squared error of other tests that fitted machines predict, where there is one to predict."""
    shares = [s.row["heldout_removed"] for s in scores if "heldout_removed" in s.row and _shows(s)]
    return f"{np.median(shares):.3f}" if shares else "none"


def is_listed(s: Score) -> bool:
    """Whether an answer is to be listed."""
    return s.mark != "right"


def said(s: Score) -> str:
    """What was said, in one line."""
    if s.mark == "crash":
        return s.row["error"].strip().splitlines()[-1].replace("|", "/")
    names = [" or ".join(names_of(e)) for e in s.row["result"]["effects"]]
    if s.unexplained:
        names.append(f"unknown on {', '.join(s.unexplained['axes'])} ({s.unexplained['variable']})")
    return "; ".join(names) or "nothing found"


def hidden(row: dict) -> str:
    """What hides in a campaign, in one line."""
    answer = row.get("answer", {})
    names = [*(e["id"] for e in answer.get("effect", [])), *filter(None, [answer.get("hidden")])]
    sizes = ", ".join(f"{x:.1f}" for x in sizes_over_noise(row)) if answer else ""
    return (", ".join(names) or "nothing") + (f" ({sizes})" if sizes else "")


# intervals


def interval_groups(scores: list[Score]) -> dict[str, list[Number]]:
    """True numbers that have an interval, by where they come from."""
    ok = [s for s in scores if s.mark != "crash"]
    tame = [s for s in ok if s.row["world"] != "wild"]
    wild = [n for s in ok if s.row["world"] == "wild" for n in s.numbers]
    return {
        "sound machines": [n for s in tame if is_sound(s) for n in s.numbers],
        "machines with listed causes": [n for s in tame if s.verdict == "effect" for n in s.numbers],
        "findings alone": [n for s in tame for n in s.numbers if n.planted and n.finding],
        "beside an unlisted cause": [n for s in tame if is_unlisted(s) for n in s.numbers],
        "wild machines, planted": [n for n in wild if n.planted],
        "wild machines, small": [n for n in wild if not n.planted],
    }


def rms_z(numbers: Iterable[Number]) -> float:
    """Root mean square of (estimate - truth) over its standard deviation."""
    z = np.array([n.z for n in numbers if n.z is not None])
    return float(np.sqrt(np.mean(z**2))) if len(z) else np.nan


# calibration of the probabilities


def names_by_kind(scores: Iterable[Score]) -> dict[str, list[tuple[float, bool]]]:
    """(probability, whether it is true) of all names by the kind of campaign: sound, faulty, unlisted or wild."""
    out: dict[str, list[tuple[float, bool]]] = {"sound": [], "faulty": [], "unlisted": [], "wild": []}
    kinds = {"none": "sound", "effect": "faulty", "unknown": "unlisted"}
    for s in scores:
        if s.mark != "crash":
            out["wild" if s.row["world"] == "wild" else kinds[s.verdict]] += s.names
    return {kind: names for kind, names in out.items() if names}


@dataclass(frozen=True)
class Bin:
    """One bin of a reliability diagram: number of names, their mean probability, and how many are true."""

    low: float
    high: float
    count: int
    stated: float
    true: int

    @property
    def error(self) -> float:
        """Share that is true less the mean probability."""
        return self.true / self.count - self.stated if self.count else np.nan


def reliability(names: list[tuple[float, bool]]) -> list[Bin]:
    """Bins of equal width over (probability, whether it is true); a probability on an edge belongs to the upper bin."""
    p = np.array([x for x, _ in names], float)
    true = np.array([x for _, x in names], bool)
    place = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    out = []
    for i, (low, high) in enumerate(itertools.pairwise(BINS)):
        mine = place == i
        stated = float(p[mine].mean()) if mine.any() else np.nan
        out.append(Bin(float(low), float(high), int(mine.sum()), stated, int(true[mine].sum())))
    return out


def brier_score(names: list[tuple[float, bool]], unseen: int) -> float:
    """Mean squared difference of probability and truth (Brier 1950); ``unseen`` causes count as a probability of 0."""
    return (sum((p - true) ** 2 for p, true in names) + unseen) / (len(names) + unseen)


def log_score(names: list[tuple[float, bool]], unseen: int) -> float:
    """Mean logarithm of the probability of what is true (Good 1952), nats; 0 is perfect."""
    each = [np.log(max(p if true else 1.0 - p, _LEAST)) for p, true in names]
    return float((sum(each) + unseen * np.log(_LEAST)) / (len(names) + unseen))


def draw_reliability(groups: dict[str, list[tuple[float, bool]]], file: Path) -> None:
    """Reliability diagram of all names with 95 % intervals, and of each group, over a histogram; as PNG and SVG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "reliability"  # the same figure is the same file
    figure, (above, below) = plt.subplots(2, 1, figsize=(5.5, 6.5), sharex=True, height_ratios=[3, 1])
    above.plot([0, 1], [0, 1], color="0.6", lw=1, label="what is stated is true")
    everything = [n for names in groups.values() for n in names]
    for label, names in {**groups, "all": everything}.items():
        bins = [b for b in reliability(names) if b.count]
        share = np.array([b.true / b.count for b in bins])
        x = [b.stated for b in bins]
        if label != "all":
            above.plot(x, share, "o-", ms=3, lw=0.8, label=f"{label} ({len(names)})")
            continue
        bounds = np.array([binomial_bounds(b.true, b.count) for b in bins]).reshape(-1, 2).T
        spread = np.abs(bounds - share)
        above.errorbar(x, share, spread, fmt="ko-", ms=5, lw=1.5, capsize=3, label=f"all ({len(names)}), 95 %")
    above.set(ylabel="share of names that are true", xlim=(0, 1), ylim=(-0.02, 1.02))
    above.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    edges = [b.low for b in reliability(everything)]
    below.bar(edges, [b.count for b in reliability(everything)], width=BINS[1], align="edge", color="0.75", ec="0.4")
    below.set(xlabel="probability that the diagnosis gives a name", ylabel="names")
    figure.tight_layout()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file.with_suffix(".png"), dpi=120)
    figure.savefig(file.with_suffix(".svg"), metadata={"Date": None})
    plt.close(figure)


# simple methods


def by_simple_methods(scores: list[Score], simple: list[dict]) -> dict[str, list[Score]]:
    """The campaigns that simple methods answered as well, by method; the diagnosis is the first."""
    theirs = {r["name"]: r for r in simple if "error" not in r}
    common = [s for s in scores if s.mark != "crash" and s.row["name"] in theirs]
    if not common:
        return {}
    methods = theirs[common[0].row["name"]]["results"]
    answers = {m: [score({**s.row, "result": theirs[s.row["name"]]["results"][m]}) for s in common] for m in methods}
    return {"diagnosis": common, **answers}
