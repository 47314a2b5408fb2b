"""``mjsim.report``: one campaign, or several of one machine over time, as one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

from mjsim.campaign.model import Campaign
from mjsim.campaign.temperature import in_campaign, remarks_on
from mjsim.commands.ball_bar.compare import BarComparison, compare_bars
from mjsim.commands.compare import compare
from mjsim.commands.diagnose import diagnosable, diagnose
from mjsim.commands.diagnosis import Diagnosis
from mjsim.errors import InputError
from mjsim.inference.mistakes.checked_problem import checked_problem
from mjsim.inference.settings import DIAGNOSIS, DiagnosisSettings
from mjsim.instruments.axis_log.measurement import LogTest
from mjsim.instruments.base import INSTRUMENTS
from mjsim.io.extras import need
from mjsim.io.files import finite
from mjsim.machine import model
from mjsim.machine.model import Machine
from mjsim.plots.temperatures import temperature_figure
from mjsim.prediction.part_run import PartRun
from mjsim.progress import Progress, silent
from mjsim.report import build, page, trend
from mjsim.report.beside import answer_of, compared_section, diagnosed_section, images_of, section_of_points


@dataclass(frozen=True)
class Report:
    """A report: ``html`` is the whole page, ``data`` its numbers and texts as plain JSON data (the page carries the
    same).
    """

    html: str
    data: dict


def need_report() -> None:
    """Refuse to begin where the page's packages are missing.

    Raises:
        InputError: the extra "report" is not installed.
    """
    need("report", "report", "jinja2", "PIL")


def report(
    campaigns: Campaign | Sequence[Campaign],
    machines: Machine | Sequence[Machine],
    max_effects: int | None = None,
    diagnosed: bool = True,
    threads: int = 2,
    progress: Progress = silent,
    parts: Sequence[PartRun] = (),
    settings: DiagnosisSettings = DIAGNOSIS,
) -> Report:
    """The report of a campaign; of several campaigns of one machine the trend.

    Nothing is written, neither here nor into the campaigns' folders.

    Args:
        campaigns: one, or at least two; those with a day of measuring come in its order, where all have one, otherwise
            as given.
        machines: the model of each.
        max_effects: at most so many missing effects are looked for; without it as many as the data prove.
        diagnosed: look for missing effects; otherwise compare only.
        threads: tests simulated side by side.
        progress: called as work gets on.
        parts: programs whose error the page of one campaign predicts.
        settings: what decides.

    Raises:
        InputError: no measured test, campaigns of different machines, or the extra is not installed.
    """
    need_report()
    if isinstance(campaigns, Campaign) or len(campaigns) == 1:
        campaign = campaigns if isinstance(campaigns, Campaign) else campaigns[0]
        machine = machines if isinstance(machines, Machine) else machines[0]
        return _single(campaign, machine, max_effects, diagnosed, threads, progress, parts, settings)
    pairs = list(
        zip(campaigns, [machines] * len(campaigns) if isinstance(machines, Machine) else machines, strict=True)
    )
    check_same_machine(pairs)
    if all(c.measured_on is not None for c, _ in pairs):
        pairs.sort(key=lambda pair: pair[0].measured_on or date.min)
    results: list[Diagnosis | BarComparison] = []
    for i, (c, m) in enumerate(pairs):

        def told(stage: str, done: int, total: int, place: str = f"{i + 1}/{len(pairs)}: ") -> None:
            progress(place + stage, done, total)

        if diagnosed:
            results.append(diagnose(c, m, max_effects, threads, told, settings).of_bars())
        else:
            results.append(compare_bars(c, m, threads, told))
    content = trend.content(results)
    return Report(page.render_trend(content), finite(content.to_json()))


def _single(
    campaign: Campaign,
    machine: Machine,
    max_effects: int | None,
    diagnosed: bool,
    threads: int,
    progress: Progress,
    parts: Sequence[PartRun],
    settings: DiagnosisSettings,
) -> Report:
    campaign.need_traces("a report needs at least one measured test")
    machine = in_campaign(machine, campaign)
    bars = bool(campaign.in_motion.measured)
    if parts and not bars:
        raise InputError(f"{campaign.folder / 'campaign.toml'}: the error of a part follows from ball-bar tests only")
    day = campaign.measured_on.isoformat() if campaign.measured_on else ""
    content, answer, sections = None, {}, {}
    able = campaign.of(*diagnosable())
    if diagnosed and able.measured:
        found = diagnose(able, machine, max_effects, threads, progress, settings)
        final = found.machine
        if bars:
            content = build.diagnosed(found.of_bars(), threads, progress, day, parts=parts)
        for rest in found.at_rest:
            sections[rest.after.instrument] = (section_of_points(found, rest), images_of(rest.after))
            answer = answer_of(found)
        if found.logs is not None:
            said = [f"{e.effect.id}: {e.evidence}" for e in found.effects if e.evidence]
            sections[LogTest.instrument] = (diagnosed_section(found.logs, said), images_of(found.logs.after))
    else:
        final = machine
        if bars:
            problem = checked_problem(campaign, model.build(machine), threads, machine=machine)
            compared = compare_bars(campaign, machine, threads, progress, problem)
            content = build.compared(problem, compared, threads, progress, day, parts)
    left = [n for n in campaign.measured_parts if n not in sections and not INSTRUMENTS[n].in_motion]
    if left:
        for part in compare(campaign.of(*left), final, threads, progress).parts:
            sections[part.instrument] = (compared_section(part), images_of(part))
    progress("writing the page", 0, 1)
    ordered = {INSTRUMENTS[n].beside: sections[n] for n in INSTRUMENTS if n in sections}
    warming = {} if campaign.temperatures is None else {"temperature": remarks_on(campaign)}
    picture = page.data_uri(temperature_figure(campaign)) if campaign.temperatures is not None else None
    if content is not None:
        html = page.render(content, ordered, (picture, warming.get("temperature", [])))
        return Report(html, finite(page.data_of(content, ordered) | warming))
    (data, images), *others = ordered.values()
    data = data | answer | warming | {key: section for (key, (section, _)) in list(ordered.items())[1:]}
    verdict = page.VERDICTS.get(data["verdict"] or "")
    html = page.page(
        "recordings.html", data, None, (), verdict=verdict, images=images, beside=others, temperature_image=picture
    )
    return Report(html, finite(data))


def check_same_machine(pairs: Sequence[tuple[Campaign, Machine]]) -> None:
    """Refuse campaigns of different machines: another name, configuration, or lead or number of worm teeth.

    Raises:
        InputError: names both campaigns and what differs.
    """
    for c, _ in pairs:
        c.in_motion.need_traces("a trend needs ball-bar tests")
    (first, one), *others = pairs
    for c, m in others:
        if (m.name, m.configuration) != (one.name, one.configuration):
            what = f"machine {one.name!r} ({one.configuration}) and {m.name!r} ({m.configuration})"
        elif axes := [a for a in one.chain.letters if m.drives[a].gear != one.drives[a].gear]:
            what = f"another lead or number of worm teeth of {', '.join(axes)}"
        else:
            continue
        raise InputError(
            f"{c.folder}: not of the same machine as {first.folder}: {what}; a trend needs campaigns of one machine"
        )
