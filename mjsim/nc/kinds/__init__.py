"""Kinds of ball-bar tests, one per file; a new one is entered here."""

from mjsim.nc.kinds.base import Kind
from mjsim.nc.kinds.circular import Circular
from mjsim.nc.kinds.cone_frustum import ConeFrustum
from mjsim.nc.kinds.rotary import Rotary

#: Name in campaign.toml -> kind.
KINDS: dict[str, Kind] = {kind.name: kind for kind in (ConeFrustum(), Circular(), Rotary())}
