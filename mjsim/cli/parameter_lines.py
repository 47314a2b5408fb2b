"""Fitted parameters of an effect as lines of text."""

from __future__ import annotations

from collections.abc import Collection

from mjsim.units import percent


def parameter_lines(parameters: dict, intervals: dict, undetermined: Collection[str] = ()) -> list[str]:
    """``name = value  [low, high]`` per parameter, components one by one; no value of one that is not determined."""
    lines = []
    for name, value in parameters.items():
        if name in undetermined:
            lines.append(f"{name}: not determined by the data")
            continue
        ci = intervals.get(name)
        if name == "components":
            for i, (order, amplitude, phase) in enumerate(value):
                band = f"  [{ci[0][i][1]:.3g}, {ci[1][i][1]:.3g}]" if ci else ""
                lines.append(f"order {order:g}: amplitude {amplitude:.4g}{band}, phase {phase:.1f}°")
        elif isinstance(value, str):
            lines.append(f"{name} = {value}")
        else:
            lines.append(f"{name} = {value:.5g}" + (f"  [{ci[0]:.5g}, {ci[1]:.5g}] (95 %)" if ci else ""))
    return lines


def _with(probability: float | None) -> str:
    return "" if probability is None else f" ({percent(probability)})"


def finding_lines(finding: dict) -> list[str]:
    """What stands below the name of a finding: its parameters, what looks like it, and where it shows."""
    lines = parameter_lines(finding["parameters"], finding["ci95"], finding.get("undetermined", ()))
    if finding.get("known_together"):
        lines.append(finding["known_together"]["sentence"])
    if finding["probability"] is not None:
        lines.append(f"probability: {percent(finding['probability'])}")
    if finding["alternatives"]:
        others = (f"{a['id']}" + _with(a["probability"]) for a in finding["alternatives"])
        lines.append(f"cannot be told from: {', '.join(others)}")
    if finding["tests"]:
        lines.append(f"shows in: {', '.join(finding['tests'])}")
    if finding.get("evidence"):
        lines.append(finding["evidence"])
    return lines
