"""Tests of a machine of the generator on which everything is a little wrong."""

import numpy as np
from independent import campaign as generator
from independent import real_machines
from independent.layouts import layout

from mjsim.campaign.files import read_campaign
from mjsim.campaign.machine_file import read_machine
from mjsim.inference.problem import Problem
from mjsim.machine.model import build


def small_errors_and(folder, more):
    """The standard tests of such a machine with ``more`` errors, the machine as its file has it, and all its errors."""
    within = (*real_machines.within("M1", np.random.default_rng(7)), *more)
    case = generator.Case("small", "M1", tuple(layout("standard")), (), seed=7, within=within, tolerance_stated=True)
    generator.write_files(case, folder)
    campaign = read_campaign(folder)
    machine = read_machine(campaign.machine_file)
    return Problem.of(campaign, build(machine), threads=2), machine, within
