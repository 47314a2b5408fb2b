"""The package's names: a function is loaded when it is used, and no package is hidden behind one."""

import importlib
import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest

import mjsim

ROOMS = [room.name for room in pkgutil.iter_modules(mjsim.__path__) if room.ispkg]


def test_a_package_stays_a_package():
    """As users write it, in a fresh process, before and after the functions have been used."""
    words = "; ".join(
        f"import mjsim.{room} as m; assert m.__name__ == 'mjsim.{room}' and m is mjsim.{room}" for room in ROOMS
    )
    use = "for name in mjsim.__all__: getattr(mjsim, name)"
    done = subprocess.run(
        [sys.executable, "-c", f"import mjsim\n{words}\n{use}\n{words}"], capture_output=True, text=True
    )
    assert ROOMS and done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", mjsim.__all__)
def test_a_name_is_no_package(name):
    for module in ("mjsim.commands.compare", "mjsim.commands.diagnose", "mjsim.effects", "mjsim.simulation.multibody"):
        importlib.import_module(module)
    assert name not in ROOMS and not isinstance(getattr(mjsim, name), ModuleType)


def test_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'dignose'"):
        _ = mjsim.dignose
