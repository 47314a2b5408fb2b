"""What figures 5 to 8 and 10 to 17 show: panels, lines and scales as the paper's captions give them."""

from __future__ import annotations

from dataclasses import dataclass

from mjsim.paper.runs import Run

#: Colour and whether the line is broken, per offset in mm: positive offsets blue and full, negative ones red and
#: broken.
OFFSET_LOOK = {
    0: ("#222222", False),
    50: ("#6baed6", False),
    200: ("#08519c", False),
    -50: ("#f28e5c", True),
    -200: ("#b8330b", True),
}
METHOD_LOOK = {"perpendicular": ("#222222", False), "parallel": ("#d9480f", True)}


@dataclass(frozen=True)
class Line:
    """One trace of a panel: a simulated run, or the measurement of a test of the example campaign."""

    label: str
    source: Run | str
    colour: str
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """One polar plot. ``um_per_div`` is the paper's scale."""

    caption: str
    lines: tuple[Line, ...]
    um_per_div: float = 10.0


@dataclass(frozen=True)
class PolarFigure:
    """One figure of polar plots.

    Attributes:
        number, title: as in the paper. conditions: the rest of its caption.
        panels: in the paper's order. columns: panels side by side. note: what a reader has to know beyond the caption.
    """

    number: int
    title: str
    conditions: str
    panels: tuple[Panel, ...]
    columns: int
    note: str = ""

    @property
    def runs(self) -> tuple[Run, ...]:
        """The simulations it needs."""
        return tuple(line.source for p in self.panels for line in p.lines if isinstance(line.source, Run))


_CCW = "CCW, feed 1000 mm/min"
_CONE = {15: f"θ = 15°, β = 10°, {_CCW}", 45: f"θ = 45°, β = 30°, {_CCW}"}
_ONE_CAUSE = "Without friction and tracking delay: the trace with the cause less the trace without."
_MEASUREMENT = (
    "Measurement: an independent simulation (example kato2013), not the paper's data; that machine has one worn "
    "flank of the A worm. "
    "Both about their own least-squares circle."
)


def _pair(theta: int, x: int, y: int) -> tuple[Line, ...]:
    name = f"x{x}" if x else f"y{y}" if y else "centre"
    return (
        Line("measurement (independent simulation)", f"cone{theta}-{name}-ccw", "#222222"),
        Line("simulation", Run("all", theta, x, y), "#d9480f"),
    )


def _against_measurement(number: int, theta: int) -> PolarFigure:
    panels = [
        Panel(f"({letter}) $O_T$ = ({x}, {y}, 155) mm", _pair(theta, x, y))
        for letter, (x, y) in zip("abc", ((0, 0), (50, 0), (0, 50)), strict=True)
    ]
    title = f"Measurement and simulation, bar perpendicular to the conical surface, half apex angle {theta}°"
    return PolarFigure(number, title, _CONE[theta], tuple(panels), 3, _MEASUREMENT)


def offset_label(offset: int) -> str:
    """An offset in mm with its sign, as the legends say it."""
    return f"{offset:+d} mm".replace("-", "−") if offset else "0 mm"


def _offsets(cause: str, theta: int, values: tuple[int, ...], um_per_div: float = 10.0) -> tuple[Panel, ...]:
    panels = []
    for letter, along in zip("ab", "XY", strict=True):
        lines = [Line(offset_label(v), Run.beside(cause, theta, along, v), *OFFSET_LOOK[v]) for v in values]
        panels.append(Panel(f"({letter}) centre offset in {along}", tuple(lines), um_per_div))
    return tuple(panels)


def _alone(cause: str) -> tuple[Line, ...]:
    return (Line("simulation", Run(cause, 15), *OFFSET_LOOK[0]),)


def _methods(number: int, x: int, y: int) -> PolarFigure:
    causes = {
        "(a) friction force": "friction",
        "(b) backlash of the A axis": "backlash.A",
        "(c) pitch error of the A axis": "pitch_error.A",
        "(d) pitch error of the C axis": "pitch_error.C",
    }
    panels = [
        Panel(caption, tuple(Line(m, Run(cause, 45, x, y, m), *look) for m, look in METHOD_LOOK.items()))
        for caption, cause in causes.items()
    ]
    conditions = f"{_CONE[45]}, $O_T$ = ({x}, {y}, 155) mm"
    return PolarFigure(
        number,
        "The two measuring methods compared, one cause at a time",
        conditions,
        tuple(panels),
        2,
        f"(b) to (d) {_ONE_CAUSE[0].lower()}{_ONE_CAUSE[1:]}",
    )


POLAR: tuple[PolarFigure, ...] = (
    _against_measurement(5, 15),
    _against_measurement(6, 45),
    PolarFigure(
        7,
        "Effect of friction of the linear axes",
        f"{_CONE[15]}, $O_T$ = (0, 0, 155) mm",
        (Panel("friction and tracking delay", _alone("friction"), 5.0),),
        1,
    ),
    PolarFigure(
        8,
        "Influence of the centre offset without mechanism errors",
        f"{_CONE[15]}, $Z_T$ = 155 mm",
        _offsets("friction", 15, (50, -50, 200, -200), 5.0),
        2,
        "The signs in (b) need a C axis that lags differently from the linear axes: its Kpp is taken 0.7 % higher "
        "(assumed).",
    ),
    PolarFigure(
        10,
        "Effect of backlash and pitch error of the A axis",
        f"{_CONE[15]}, $O_T$ = (0, 0, 155) mm",
        (Panel("(a) backlash", _alone("backlash.A")), Panel("(b) pitch error", _alone("pitch_error.A"))),
        2,
        _ONE_CAUSE,
    ),
    PolarFigure(
        11,
        "Effect of the pitch error of the C axis",
        f"{_CONE[15]}, $Z_T$ = 155 mm",
        _offsets("pitch_error.C", 15, (50, 200)),
        2,
        f"{_ONE_CAUSE} The paper's caption prints $O_T$ = (0, 0, 155), where this cause would not show at all.",
    ),
    PolarFigure(
        12,
        "Effect of friction of the linear axes",
        f"{_CONE[45]}, $Z_T$ = 155 mm",
        _offsets("friction", 45, (0, 200, -200)),
        2,
    ),
    PolarFigure(
        13,
        "Effect of the backlash of the A axis",
        f"{_CONE[45]}, $Z_T$ = 155 mm",
        _offsets("backlash.A", 45, (0, 200, -200)),
        2,
        _ONE_CAUSE,
    ),
    PolarFigure(
        14,
        "Effect of the pitch error of the A axis",
        f"{_CONE[45]}, $Z_T$ = 155 mm",
        _offsets("pitch_error.A", 45, (0, 200, -200)),
        2,
        _ONE_CAUSE,
    ),
    PolarFigure(
        15,
        "Effect of the pitch error of the C axis",
        f"{_CONE[45]}, $Z_T$ = 155 mm",
        _offsets("pitch_error.C", 45, (200,)),
        2,
        _ONE_CAUSE,
    ),
    _methods(16, 200, 0),
    _methods(17, 0, 200),
)
#: Offsets of Fig. 9, mm, and the plane of each panel: (axis shown with C, direction of the offset).
VELOCITY_OFFSETS = (-200, -50, 0, 50, 200)
VELOCITY_PANELS = (("X", "X"), ("Y", "X"), ("X", "Y"), ("Y", "Y"))
VELOCITY_RUNS = tuple(Run.beside("friction", 15, along, v) for along in "XY" for v in VELOCITY_OFFSETS)
