"""Fits of campaigns in which the table turns once each way, for tests of causes outside the catalogue."""

from independent import campaign as generator
from independent.layouts import layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.effects import registry
from mjsim.estimation.effect_vector import EffectVector
from mjsim.estimation.fit import Fitter
from mjsim.estimation.problem import Problem
from mjsim.machine.model import build


def free(machine, effect_id, **values):
    """An effect whose last value is fitted."""
    cls, subject = registry.effect_class(effect_id, machine.chain)
    return EffectVector(cls(subject, **values), tuple(values)[-1:])


def fitter_of(hidden, folder, kind="rotary-c-tangential"):
    """For a campaign of a turn of the table each way, and its machine."""
    tests = [t for t in layout("rotaries") if t["name"].startswith(kind)]
    generator.write_files(generator.Case("c", "M1", tuple(tests), hidden, seed=3, tolerance_stated=True), folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    return Fitter(Problem.of(campaign, build(machine), threads=2), machine), machine
