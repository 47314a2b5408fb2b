"""The MJCF text of a machine made of links."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np

from mjsim.io.resources import scene_file
from mjsim.machine.chain import Chain, usual_travel
from mjsim.machine.modelling.assembly import BALL, BALL_HEIGHT, TOP, Assembly, Link, Solid, assembled, points, weights

_MATERIALS = {
    "white": "0.86 0.88 0.89 1",
    "light_grey": "0.63 0.66 0.69 1",
    "dark_grey": "0.38 0.41 0.44 1",
    "graphite": "0.15 0.16 0.18 1",
    "blue": "0.07 0.27 0.55 1",
    "iron": "0.36 0.37 0.38 1",
    "steel": "0.72 0.74 0.76 1",
    "ball": "0.93 0.94 0.96 1",
    "mark": "0.95 0.75 0.08 1",
    "bar": "1 0.3 0.02 1",
}
#: Length of the bar in the key frame, m.
BAR = 0.1
#: Natural frequency of a viewer's sliders, rad/s (assumed; no model of the drives).
_VIEWER = 8.0
#: Motor's share of an axis' inertia until a machine file says more: this many times that of the bodies (assumed).
_ARMATURE = 2.0
_HEAD = """<mujoco model={name}>
  <!--
       {title}
       Metres, kilograms, radians. With all axes at 0 the spindle ball is at the origin.
       Shapes and masses are assumed. Moving bodies are balanced and their weight is compensated.
       Keep the names of joints, bodies "table" and "table_fixture", and sites.
  -->
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <default>
    <geom group="2" friction="0.1"/>
    <site type="sphere" size="0.002" group="4"/>
    <joint damping="0"/>
  </default>
  <asset>
{materials}
  </asset>
  <worldbody>
"""


def machine_xml(chain: Chain, name: str = "machine") -> str:
    """The MJCF model of a machine with these axes: bodies, joints, sites of both balls, sensors and sliders.

    Args:
        chain: the machine's axes.
        name: of the model.
    """
    return _text(assembled(chain), name)


def _text(assembly: Assembly, name: str) -> str:
    chain = assembly.chain
    materials = "\n".join(f'    <material name="{k}" rgba="{v}"/>' for k, v in _MATERIALS.items())
    out = [_HEAD.format(name=quoteattr(name), title=f"Machine {chain.configuration}.", materials=materials)]
    weigh, travel = weights(assembly), dict(zip(chain.letters, usual_travel(chain), strict=True))
    out.append('    <body name="bed">\n')
    out += [_geom(s, np.zeros(3), "      ") for s in assembly.bed.solids]
    for links, last in ((assembly.tool, assembly.spindle), (assembly.work, assembly.table)):
        out.append(_nested(links, np.zeros(3), last, chain, weigh, travel, "      "))
    out.append("    </body>\n  </worldbody>\n")
    order = [k.axis.letter for k in (*assembly.tool, *assembly.work) if k.axis]
    first = [links[0].name for links in (assembly.work, assembly.tool) if links]
    loose = [n for n, links in (("table", assembly.work), ("spindle", assembly.tool)) if not links]
    excluded = "".join(f'    <exclude body1="bed" body2="{b}"/>\n' for b in (*first, *loose))
    out.append(f"  <!-- These touch the bed always. -->\n  <contact>\n{excluded}  </contact>\n")
    out.append(_TENDON)
    carried: dict[str, float] = {}
    for links in (assembly.work, assembly.tool):
        carried |= {k.axis.letter: _carried(links[i:], weigh) for i, k in enumerate(links) if k.axis}
    out.append("  <!-- For the sliders of a viewer. They are no model of the drives. -->\n  <actuator>\n")
    for a in order:
        kp = (1 + _ARMATURE) * carried[a] * _VIEWER**2
        control = "" if a not in chain.round_axes else ' ctrlrange="-6.2832 6.2832"'
        inherit = control or ' inheritrange="1"'
        out.append(f'    <position name="{a}" joint="{a}" kp="{kp:.6g}" dampratio="1"{inherit}/>\n')
    out.append("  </actuator>\n  <sensor>\n")
    out += [f'    <jointpos name="{a}_pos" joint="{a}"/>\n' for a in order]
    out.append(_SENSORS)
    if chain.spatial:
        home = dict(zip(chain.linear, (BAR, 0.0, BALL_HEIGHT), strict=True))
        at = _numbers([home.get(a, 0.0) for a in order])
        out.append(
            f"  <keyframe>\n    <!-- In the order {' '.join(order)}. The bar is {BAR:g} m long. -->\n"
            f'    <key name="home" qpos="{at}" ctrl="{at}"/>\n  </keyframe>\n'
        )
    return "".join(out) + "</mujoco>\n"


_TENDON = """  <!-- The ball bar is drawn between the two balls. -->
  <tendon>
    <spatial name="ball_bar" width="0.0045" material="bar">
      <site site="table_ball"/>
      <site site="spindle_ball"/>
    </spatial>
  </tendon>
"""
_SENSORS = """    <framepos name="spindle_ball_pos" objtype="site" objname="spindle_ball"/>
    <framepos name="table_ball_pos" objtype="site" objname="table_ball"/>
    <tendonpos name="ball_bar_length" tendon="ball_bar"/>
  </sensor>
"""


def _nested(links: tuple[Link, ...], parent: np.ndarray, last: Link, chain: Chain, weigh, travel, pad: str) -> str:
    """Bodies of a side, each inside the one that carries it; ``parent`` (3,) is the origin of what carries them."""
    if not links:
        return _end(last, parent, pad)
    link, axis = links[0], links[0].axis
    assert axis is not None
    mass, centre, inertia = weigh[link.name]
    own = _carried(links, weigh)
    limits = "" if axis.letter in chain.round_axes else f' range="{_numbers(travel[axis.letter])}"'
    kind = "hinge" if axis.rotary else "slide"
    lines = [
        f"{pad}<!-- {link.role} -->\n"
        f'{pad}<body name="{link.name}" pos="{_numbers(link.origin - parent)}" gravcomp="1">\n',
        f'{pad}  <joint name="{axis.letter}" type="{kind}" axis="{_numbers(link.sign * axis.direction)}"{limits} '
        f'armature="{_ARMATURE * own:.6g}"/>\n',
        f'{pad}  <inertial pos="{_numbers(centre - link.origin)}" mass="{mass:g}" '
        f'diaginertia="{inertia:g} {inertia:g} {inertia:g}"/>\n',
        *(_geom(s, link.origin, pad + "  ") for s in link.solids),
        _nested(links[1:], link.origin, last, chain, weigh, travel, pad + "  "),
        f"{pad}</body>\n",
    ]
    return "".join(lines)


def _carried(links: tuple[Link, ...], weigh) -> float:
    """Mass or moment of inertia that the axis of the first link moves, kg or kg·m²."""
    axis = links[0].axis
    assert axis is not None
    if not axis.rotary:
        return sum(weigh[k.name][0] for k in links)
    total = 0.0
    for link in links:
        mass, centre, inertia = weigh[link.name]
        total += inertia + mass * float(np.sum(np.cross(axis.direction, centre - axis.centre) ** 2))
    return total


def _end(last: Link, parent: np.ndarray, pad: str) -> str:
    """The table or the spindle, whose frame has the machine's origin."""
    inner = "".join(_geom(s, np.zeros(3), pad + "  ") for s in last.solids)
    if last.name == "table":
        inner += (
            f"{pad}  <!-- Origin: centre of the ball. Code moves this body. -->\n"
            f'{pad}  <body name="table_fixture" pos="0 0 {BALL_HEIGHT}">\n'
            + "".join(_geom(s, np.zeros(3), pad + "    ") for s in _fixture())
            + f'{pad}    <site name="table_ball"/>\n{pad}  </body>\n'
        )
    else:
        inner += f'{pad}  <site name="spindle_ball"/>\n'
    return f'{pad}<body name="{last.name}" pos="{_numbers(-parent)}" gravcomp="1">\n{inner}{pad}</body>\n'


def _fixture() -> list[Solid]:
    """Post with a cup under the table ball."""
    foot = TOP - BALL_HEIGHT
    return [
        Solid("cylinder", (0.0, 0.0, foot + 0.009), (0.024, 0.007), "graphite"),
        Solid("cylinder", (0.0, 0.0, (foot + 0.016 - 0.012) / 2), (0.009, (-0.012 - foot - 0.016) / 2), "steel"),
        Solid("sphere", (0.0, 0.0, 0.0), (BALL,), "ball", name="table_ball"),
    ]


def _geom(solid: Solid, origin: np.ndarray, pad: str) -> str:
    named = f' name="{solid.name}"' if solid.name else ""
    turned = ""
    if solid.shape == "cylinder" and abs(solid.along[2]) < 1.0 - 1e-12:
        turned = f' zaxis="{_numbers(solid.along)}"'
    return (
        f'{pad}<geom{named} type="{solid.shape}" size="{_numbers(solid.size)}" '
        f'pos="{_numbers(np.array(solid.centre) - origin)}"{turned} material="{solid.material}"/>\n'
    )


def _numbers(values) -> str:
    """Numbers that read back exactly; what is 0 but for rounding is 0."""
    return " ".join(repr(float(v)) if abs(v) > 1e-15 else "0" for v in values)


# -- the scene around a machine made of its chain ----------------------------------------------------------------------


def scene_xml(chain: Chain, model: str) -> str:
    """The shipped scene around another machine.

    Args:
        chain: the machine's axes.
        model: file of its model, beside the scene.
    """
    assembly = assembled(chain)
    links = (assembly.bed, *assembly.work, assembly.table, *assembly.tool, assembly.spindle)
    corners = points(s for k in links for s in k.solids)
    middle, size = (corners.min(axis=0) + corners.max(axis=0)) / 2, float(np.ptp(corners, axis=0).max())
    text = scene_file().read_text(encoding="utf-8")
    for camera, away, fovy in (("overview", (-1.05, -1.26, 0.61), 42), ("side", (-1.8, -0.48, 0.38), 37)):
        seen = _looking(middle + size * np.array(away), middle)
        text = _replaced(text, f'<camera name="{camera}"', f'{seen} fovy="{fovy}"')
    floor = f'type="plane" size="0 0 0.05" pos="0 0 {assembly.floor:g}" material="floor"'
    text = _replaced(text, '<geom name="floor"', floor)
    return text.replace('file="five_axis.xml"', f'file="{model}"').replace('"five_axis scene"', '"machine scene"')


def whole_scene(chain: Chain) -> str:
    """The scene and the machine in it as one text."""
    inside = machine_xml(chain).partition(">")[2].rpartition("</mujoco>")[0]
    scene = scene_xml(chain, "machine.xml")
    return scene.replace('<include file="machine.xml"/>', inside)


def _replaced(text: str, start: str, attributes: str) -> str:
    """``text`` with other attributes behind ``start`` of an element."""
    head, _, rest = text.partition(start)
    return f"{head}{start} {attributes}/>{rest.partition('/>')[2]}"


def _looking(eye: np.ndarray, at: np.ndarray) -> str:
    """Position and orientation of a camera that looks from one point at another."""
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.concatenate([right, np.cross(back, right)])
    return f'pos="{" ".join(f"{v:.6g}" for v in eye)}" xyaxes="{" ".join(f"{v:.6g}" for v in axes)}"'
