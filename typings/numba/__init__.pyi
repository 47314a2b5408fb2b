"""Types of what mjsim uses of Numba: a compiled function has the types of its Python source."""

from collections.abc import Callable
from typing import Any, TypeVar, overload

import numpy as np

from . import types as types

_F = TypeVar("_F", bound=Callable[..., Any])

@overload
def njit(function: _F) -> _F: ...
@overload
def njit(
    *, cache: bool = ..., nogil: bool = ..., error_model: str = ..., inline: str = ..., fastmath: bool = ...
) -> Callable[[_F], _F]: ...

class CFunc:
    """A function that C can call."""

    address: int

def cfunc(signature: object, *, cache: bool = ...) -> Callable[[Callable[..., Any]], CFunc]: ...
def carray(pointer: Any, shape: tuple[Any, ...]) -> np.ndarray: ...
