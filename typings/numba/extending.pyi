from collections.abc import Callable
from typing import Any

#: The typing context is the compiler's own argument: callers leave it out.
def intrinsic(function: Callable[..., Any]) -> Callable[..., Any]: ...
