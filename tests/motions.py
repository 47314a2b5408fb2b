"""Load-side motions of one test, for the tests of what acts between motor and load."""

from mjsim.machine.model import build


def load(motion, machine, *effects):
    """Load-side positions of ``motion`` with effects added to the machine."""
    for effect in effects:
        machine = machine.with_effect(effect)
    return motion.load(build(machine))
