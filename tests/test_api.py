"""The package's names: importing a module of a function's name does not hide the function."""

import importlib

import pytest

import mjsim


@pytest.mark.parametrize("name", ["compare", "diagnose", "effects", "simulate", "add", "history"])
def test_functions_stay_functions(name):
    for module in ("mjsim.workflow.compare", "mjsim.workflow.diagnose", "mjsim.effects", "mjsim.simulation.multibody"):
        importlib.import_module(module)
    assert callable(getattr(mjsim, name))


def test_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'dignose'"):
        _ = mjsim.dignose
