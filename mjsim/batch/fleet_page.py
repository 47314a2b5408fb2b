"""The page of a fleet: what was found how often, and the trend of every machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib.metadata import version

from mjsim.report.content import ParameterRow, estimate, interval, plain
from mjsim.report.page import VERDICTS, page
from mjsim.report.trend import CHANGED, Series, series_of

#: Most sizes that are drawn for one machine, and the share of its limit from which a calibrated number is one of them.
_MOST, _USED = 9, 60.0
#: Width and height of a drawn trend, and the room left, right, above and below, px.
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 250, 96, 8, 8, 8, 8


def render(campaigns: Sequence[dict]) -> str:
    """The page as HTML text.

    Args:
        campaigns: Results of :func:`mjsim.batch.diagnoses.diagnosed`.
    """
    data = content(campaigns)
    return page("fleet.html", data, None, (), verdict_names=VERDICTS, changed=CHANGED)


def content(campaigns: Sequence[dict]) -> dict:
    """Every number and text of the page."""
    by_machine: dict[tuple[str, str], list[dict]] = {}
    for c in campaigns:
        if c.get("error") is None:
            by_machine.setdefault((c["machine"], c["configuration"]), []).append(c)
    machines = [_machine(name, configuration, rows) for (name, configuration), rows in by_machine.items()]
    machines.sort(key=lambda m: (-m["attention"], m["name"]))
    done = [c for c in campaigns if c.get("error") is None]
    named = Counter(effect for c in done for effect in dict.fromkeys(f["effect"] for f in c["findings"]))
    titles = {f["effect"]: f["title"] for c in done for f in c["findings"]}
    owners = {
        effect: len(
            {(c["machine"], c["configuration"]) for c in done if effect in {f["effect"] for f in c["findings"]}}
        )
        for effect in named
    }
    return {
        "title": f"Fleet of {len(machines)} machine{'s' if len(machines) != 1 else ''}",
        "campaigns": len(campaigns),
        "verdicts": dict(Counter(c["verdict"] for c in done)),
        "frequent": [
            {"effect": e, "title": titles[e], "campaigns": n, "machines": owners[e]} for e, n in named.most_common(15)
        ],
        "failures": [
            {"folder": c["folder"], "campaign": c.get("campaign"), "machine": c.get("machine"), "error": c["error"]}
            for c in campaigns
            if c.get("error") is not None
        ],
        "machines": machines,
        "provenance": [("mjsim", version("mjsim")), ("MuJoCo", version("mujoco"))],
    }


def _machine(name: str, configuration: str, campaigns: list[dict]) -> dict:
    """One machine: its campaigns in the order of measuring, and its sizes over them."""
    if all(c["date"] for c in campaigns):
        campaigns = sorted(campaigns, key=lambda c: c["date"])
    last = campaigns[-1]
    labels = [c["date"] or c["campaign"] for c in campaigns]
    series = [_drawn(s, limit, expected, labels) for s, limit, expected in _series(campaigns)]
    worst = 2.0 * (last["verdict"] in ("unknown", "ambiguous")) + 3.0 * bool(last["findings"])
    return {
        "name": name,
        "configuration": configuration,
        "attention": worst + min(last["rms_before_um"] / max(last["noise_um"], 1e-3), 1e3) / 1e3,
        "campaigns": [
            {
                "campaign": c["campaign"],
                "folder": c["folder"],
                "date": c["date"],
                "tests": c["tests"],
                "verdict": c["verdict"],
                "noise_um": c["noise_um"],
                "rms_before_um": c["rms_before_um"],
                "rms_after_um": c["rms_after_um"],
                "unexplained": c["unexplained"],
                "findings": [_short(f) for f in c["findings"]],
            }
            for c in campaigns
        ],
        "series": series,
        "moved": [s["name"] for s in series if s["verdict"] in CHANGED],
    }


def _short(f: dict) -> str:
    """A finding in a few words, such as ``backlash.A width_deg 0.0024 [0.0023, 0.0025] °, 58 %``."""
    share = f"{100.0 * f['share']:.0f} %"
    if f["value"] is None:
        return f"{f['effect']}, {share}"
    row = ParameterRow("", f["value"], f["low"], f["high"])
    ends = f" [{interval(row).replace(' to ', ', ')}]" if f["low"] is not None else ""
    return f"{f['effect']} {f['number']} {estimate(row)}{ends} {f['unit']}".rstrip() + f", {share}"


def _series(campaigns: list[dict]) -> list[tuple[Series, float | None, float]]:
    """Sizes that were a finding in any campaign, then calibrated numbers that use much of their limit; each with its
    limit and what is expected of it.
    """
    rank: dict[tuple[str, str, str], float] = {}
    for c in campaigns:
        for f in c["findings"]:
            if f["value"] is not None:
                key = f["effect"], f["number"], f["unit"]
                rank[key] = max(rank.get(key, 0.0), 1e3 + f["share"])
        for n in c["calibration"]:
            if n["observable"] and n["used_percent"] >= _USED:
                key = n["effect"], n["number"], n["unit"]
                rank[key] = max(rank.get(key, 0.0), n["used_percent"])
    out = []
    for key in sorted(rank, key=lambda k: -rank[k])[:_MOST]:
        rows = [_value(c, key) for c in campaigns]
        values = [r["value"] if r else None for r in rows]
        half = [0.5 * (r["high"] - r["low"]) if r and r["low"] is not None else None for r in rows]
        known = next((r for r in rows if r and r.get("limit") is not None), None)
        expected = known["expected"] if known else 0.0
        title = f"{key[0]} {key[1]}"
        notes = ["" if r is None else "finding" if "share" in r else "within tolerance" for r in rows]
        made = series_of(title, key[2], "parameter", values, half, notes, expected)
        out.append((made, known["limit"] if known else None, expected))
    return out


def _value(c: dict, key: tuple[str, str, str]) -> dict | None:
    rows = [*c["findings"], *c["calibration"]]
    return next((r for r in rows if (r["effect"], r["number"], r["unit"]) == key and r["value"] is not None), None)


def _drawn(s: Series, limit: float | None, expected: float, labels: list[str]) -> dict:
    """A series with the places at which it is drawn, in px."""
    ends = [v for v in (*s.values, *s.lows, *s.highs, expected) if v is not None]
    low, high = min(ends), max(ends)
    lines = []
    if limit is not None:
        inside = [y for y in (expected - limit, expected + limit) if low - limit <= y <= high + limit]
        low, high = min([low, *inside]), max([high, *inside])
    span = (high - low) or 1.0

    def y(value: float) -> float:
        return round(_TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - value) / span, 1)

    step = (_WIDTH - _LEFT - _RIGHT) / max(len(labels) - 1, 1)
    points = [
        {
            "x": round(_LEFT + i * step, 1),
            "y": y(v),
            "top": None if s.highs[i] is None else y(s.highs[i] or 0.0),
            "end": None if s.lows[i] is None else y(s.lows[i] or 0.0),
            "finding": s.notes[i] == "finding",
            "label": f"{labels[i]}: {_with_unit(v, s, i)}, {s.notes[i]}",
        }
        for i, v in enumerate(s.values)
        if v is not None
    ]
    if limit is not None:
        lines = [y(v) for v in (expected - limit, expected + limit) if low <= v <= high]
    return plain(s) | {
        "limit": limit,
        "points": points,
        "lines": lines,
        "middle": y(expected) if low <= expected <= high else None,
        "first": _end(s, labels, 0),
        "last": _end(s, labels, -1),
        "change_text": "" if s.change is None else _with_unit(s.change, s, None),
    }


def _end(s: Series, labels: list[str], i: int) -> str:
    """The first or the last campaign, with the value there."""
    value = s.values[i]
    return labels[i] if value is None else f"{labels[i]}: {_with_unit(value, s, range(len(labels))[i])}"


def _with_unit(value: float, s: Series, i: int | None) -> str:
    half = s.uncertainty if i is None else None if s.highs[i] is None else (s.highs[i] or 0.0) - value
    text = estimate(ParameterRow("", value, value - half, value + half) if half else ParameterRow("", value))
    return f"{text} {s.unit}".rstrip()
