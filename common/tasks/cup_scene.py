"""The scene of the cup task as MJCF: table, cabinet with two sprung doors, cup with a handle.

Sizes and masses follow the simulation of the paper. What differs: there the doors fly open when an
episode begins, against springs that rest at 1.8 rad, and dry friction holds them at 1.93 to 1.99
rad. In the engine dry friction creeps (0.1 rad in 17 s), so here the springs rest where the doors
stand, and the doors stand there from the start.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from common.tasks.table import Table, numbers

TABLE_TOP_M = 0.625
CABINET_FLOOR_M = -0.18
"""The cabinet's inner floor in its own frame, 70 mm above the table."""
CABINET_BASE_M = -0.25
"""The cabinet's underside in its own frame."""
OPENING_Y_M = 0.15
"""The cabinet's open front in its own frame."""
DOOR_OPEN_RAD = 1.95
"""How far doors stand open when nothing touches them."""

CUP_RADIUS_M = 0.080
CUP_HALF_HEIGHT_M = 0.080
HANDLE_RING_M = 0.099
"""Centre of the handle's half ring from the cup's axis, along the cup's +y."""
HANDLE_OUTER_M = 0.050
HANDLE_INNER_M = 0.030
HANDLE_WIDTH_M = 0.010
HANDLE_GRIP_M = HANDLE_RING_M + 0.5 * (HANDLE_INNER_M + HANDLE_OUTER_M)
"""Middle of the handle's outer part from the cup's axis: where it is taken."""

_SEGMENTS = 8

TABLE = Table(top_m=TABLE_TOP_M, centre_x_m=0.75, half_depth_m=0.375)


def build_cup_scene() -> str:
    """MJCF of floor, table, cabinet and cup."""
    return f"""
<mujoco model="cup">
  <compiler angle="radian"/>
  <default>
    <geom friction="0.7 0.005 0.0001"/>
    <default class="cabinet"><geom type="box" rgba="0.58 0.44 0.30 1"/></default>
    <default class="door"><geom type="box" rgba="0.36 0.52 0.56 1"/></default>
    <default class="knob"><geom type="box" rgba="0.88 0.86 0.80 1"/></default>
    <default class="cup"><geom type="box"/></default>
    <default class="handle"><geom type="box" rgba="0.14 0.20 0.42 1"/></default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="4 4 0.1" rgba="0.55 0.56 0.58 1"/>
    {TABLE.build()}
    <body name="cabinet">
      <freejoint/>
      {_cabinet()}
      {_door("right", side=1.0)}
      {_door("left", side=-1.0)}
    </body>
    <body name="cup">
      <freejoint/>
      {_cup_shell()}
      {_cup_handle()}
    </body>
  </worldbody>
</mujoco>
"""


def _cabinet() -> str:
    """Base, top, back and two sides around a cavity of 0.46 x 0.28 x 0.36 m: 5 kg."""
    plates = (
        ("base", "0.25 0.15 0.035", "0 0 -0.215", 2.0, ""),
        ("top", "0.25 0.15 0.01", "0 0 0.19", 0.8, ""),
        ("back", "0.23 0.01 0.18", "0 -0.14 0", 0.9, 'rgba="0.78 0.74 0.62 1"'),
        ("side_0", "0.01 0.15 0.18", "0.24 0 0", 0.65, ""),
        ("side_1", "0.01 0.15 0.18", "-0.24 0 0", 0.65, 'rgba="0.46 0.34 0.24 1"'),
    )
    return _lines(
        f'<geom name="cabinet_{name}" class="cabinet" size="{size}" pos="{place}" mass="{mass:g}" '
        f"{look}/>"
        for name, size, place, mass, look in plates
    )


def _door(name: str, *, side: float) -> str:
    """A door of 0.162 kg on a sprung hinge at x = 0.25 `side`; it closes towards the middle.

    The hinge is at 0 when closed and grows as the door opens, whichever side it is on.
    """
    return f"""<body name="door_{name}" pos="{numbers(0.25 * side, OPENING_Y_M, 0)}"
            euler="0 0 {-side * DOOR_OPEN_RAD:.9g}">
        <joint name="door_{name}" type="hinge" axis="0 0 {-side:g}" range="0 {math.pi:.9g}"
               ref="{DOOR_OPEN_RAD:.9g}" springref="{DOOR_OPEN_RAD:.9g}" stiffness="1"
               damping="0.05" frictionloss="0.3"/>
        <geom name="door_{name}" class="door" size="0.125 0.01 0.2"
              pos="{numbers(-0.125 * side, 0.01, 0)}" mass="0.15"/>
        <geom name="door_{name}_post_0" class="knob" size="0.005 0.014 0.005"
              pos="{numbers(-0.22 * side, 0.033, 0.035)}" mass="0.001"/>
        <geom name="door_{name}_post_1" class="knob" size="0.005 0.014 0.005"
              pos="{numbers(-0.22 * side, 0.033, -0.035)}" mass="0.001"/>
        <geom name="door_{name}_bar" class="knob" size="0.013 0.013 0.04"
              pos="{numbers(-0.22 * side, 0.06, 0)}" mass="0.01"/>
      </body>"""


def _cup_shell() -> str:
    """Eight walls of 10 mm around a base; two tones tell how the cup is turned."""
    half_width = CUP_RADIUS_M * math.tan(math.pi / _SEGMENTS)
    walls = [
        '<geom name="cup_base" type="cylinder" class="cup" size="0.072 0.01" pos="0 0 -0.065" '
        'mass="0.02" rgba="0.55 0.57 0.60 1"/>'
    ]
    for i in range(_SEGMENTS):
        angle = 2.0 * math.pi * i / _SEGMENTS
        tone = "0.93 0.92 0.88 1" if i % 2 else "0.74 0.30 0.24 1"
        walls.append(
            f'<geom name="cup_wall_{i}" class="cup" size="0.005 {half_width:.6g} '
            f'{CUP_HALF_HEIGHT_M:g}" pos="{0.075 * math.cos(angle):.9f} '
            f'{0.075 * math.sin(angle):.9f} 0" euler="0 0 {angle:.9f}" mass="0.009" rgba="{tone}"/>'
        )
    return _lines(walls)


def _cup_handle() -> str:
    """A half ring in the cup's y-z plane, and two stubs that join it to the wall."""
    radius = 0.5 * (HANDLE_INNER_M + HANDLE_OUTER_M)
    half = 0.5 * (HANDLE_OUTER_M - HANDLE_INNER_M)
    length = HANDLE_OUTER_M * math.tan(0.5 * math.pi / _SEGMENTS)
    parts = [
        f'<geom name="cup_stub_{i}" class="handle" size="{numbers(0.005, 0.011, half)}" '
        f'pos="{numbers(0, 0.089, z)}" mass="0.001"/>'
        for i, z in enumerate((radius, -radius))
    ]
    for i in range(_SEGMENTS):
        angle = math.pi * ((i + 0.5) / _SEGMENTS - 0.5)
        y, z = HANDLE_RING_M + radius * math.cos(angle), radius * math.sin(angle)
        parts.append(
            f'<geom name="cup_handle_{i}" class="handle" '
            f'size="{numbers(0.5 * HANDLE_WIDTH_M, half, length)}" '
            f'pos="0 {y:.9f} {z:.9f}" euler="{angle:.9f} 0 0" mass="0.0015"/>'
        )
    return _lines(parts)


def _lines(elements: Iterable[str]) -> str:
    return "\n      ".join(elements)
