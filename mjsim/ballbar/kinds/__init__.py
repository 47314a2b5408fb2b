"""Kinds of ball-bar tests, one per file; a new one is entered here."""

from mjsim.ballbar.kinds.base import Kind
from mjsim.ballbar.kinds.circular import Circular
from mjsim.ballbar.kinds.cone_frustum import ConeFrustum
from mjsim.ballbar.kinds.rotary import Rotary

#: Name in campaign.toml -> kind.
KINDS: dict[str, Kind] = {kind.name: kind for kind in (ConeFrustum(), Circular(), Rotary())}
