"""The scene of the ladle task as MJCF: table, stove, pot, ladle and utensil case.

Sizes and masses follow the simulation of the paper. So does the way in which the ladle leans, with
three changes that let it rest whatever its turn about the pot:

- There it stands on the corner of the stove's plate and falls off it when turned. Here it stands
  30 mm nearer to the pot and 16 deg nearer to the middle of the plate's edge.
- The pot is turned so that one straight wall, not a corner, is behind the ladle.
- The stick is round. A square one lies on the rim along a line, to which the solver finds now one
  and now two contacts, so it trembles and creeps.
"""

from __future__ import annotations

import math

import numpy as np

from common.se3 import Array, exp3, make_pose
from common.tasks.stove import POT_APOTHEM_M, POT_RIM_M, build_pot, build_stove
from common.tasks.table import Table, numbers

TABLE_TOP_M = 0.625
CASE_BASE_M = -0.010
"""The case's underside in its own frame."""
CASE_FLOOR_M = 0.030
CAVITY_HALF_X_M = 0.080
CAVITY_HALF_Y_M = 0.130
CAVITY_TOP_M = 0.085
"""Up to here a middle counts as inside; the case's rim is at 0.070."""

HANDLE_HALF_WIDTH_M = 0.020
HANDLE_HALF_LENGTH_M = 0.040
STICK_RADIUS_M = 0.010
SCOOP_CENTRE_M = (0.0, 0.020, 0.145)
"""In the ladle's frame: origin in the middle of the handle, z along the shaft to the scoop."""

LYING_RAD = math.atan2(0.030, 0.170)
"""How much the shaft rises when handle and scoop lie on a floor, the scoop hanging down."""

_FOOT_M = 0.170
"""Where the handle stands on the stove, from the pot's axis."""
_RISE_RAD = math.radians(51.0)
"""How much the leaning shaft rises, roughly."""

TABLE = Table(top_m=TABLE_TOP_M, centre_x_m=0.75, half_depth_m=0.375)


def build_ladle_scene() -> str:
    """MJCF of floor, table, stove, pot, ladle and utensil case."""
    return f"""
<mujoco model="ladle">
  <compiler angle="radian"/>
  <default>
    <geom friction="0.7 0.005 0.0001"/>
    <default class="pot"><geom rgba="0.62 0.64 0.68 1"/></default>
    <default class="dark"><geom rgba="0.13 0.13 0.15 1"/></default>
    <default class="case"><geom type="box" rgba="0.30 0.44 0.40 1"/></default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="4 4 0.1" rgba="0.55 0.56 0.58 1"/>
    {TABLE.build()}
    {build_stove()}
    {build_pot()}
    <body name="ladle">
      <freejoint/>
      <geom name="ladle_handle" type="box" size="0.02 0.02 0.04" mass="0.094"
            rgba="0.72 0.34 0.14 1"/>
      <geom name="ladle_stick" type="capsule" size="0.01 0.06" pos="0 0 0.09" mass="0.035"
            rgba="0.90 0.90 0.88 1"/>
      <geom name="ladle_scoop" type="box" size="0.03 0.03 0.015"
            pos="{numbers(*SCOOP_CENTRE_M)}" mass="0.079" rgba="0.34 0.36 0.42 1"/>
    </body>
    <body name="case">
      <freejoint/>
      <geom name="case_floor" class="case" size="0.10 0.15 0.02" pos="0 0 0.01" mass="3.50"
            rgba="0.20 0.24 0.26 1"/>
      <geom name="case_end_0" class="case" size="0.08 0.01 0.03" pos="0 0.14 0.04" mass="0.31"
            rgba="0.86 0.82 0.62 1"/>
      <geom name="case_end_1" class="case" size="0.08 0.01 0.03" pos="0 -0.14 0.04" mass="0.31"/>
      <geom name="case_side_0" class="case" size="0.01 0.15 0.03" pos="0.09 0 0.04" mass="0.43"/>
      <geom name="case_side_1" class="case" size="0.01 0.15 0.03" pos="-0.09 0 0.04" mass="0.43"/>
    </body>
  </worldbody>
</mujoco>
"""


def lean_on_pot(turn_rad: float) -> Array:
    """T_pot_ladle (4, 4) of the ladle at rest, leaning on the pot's wall at -x.

    The lower edge of the handle stands on the stove, at r from the pot's axis and square to the
    shaft, which points at that axis and touches the straight rim. With the turn t and the rise e
    of the shaft, its axis is the stick's radius R above the rim when A cos e - B sin e = C, with
    A = h cos t, B = r cos t - a, C = w cos t - R n, where h and a are the rim's height and distance
    from the axis, w is half the handle's width and n = sqrt(1 - cos(e)^2 sin(t)^2), nearly 1.

    Args:
        turn_rad: Turn about the pot's vertical axis, within 15 deg, to stay on one wall.
    """
    cos_t, sin_t = math.cos(turn_rad), math.sin(turn_rad)
    n = math.sqrt(1.0 - (math.cos(_RISE_RAD) * sin_t) ** 2)
    A, B = POT_RIM_M * cos_t, _FOOT_M * cos_t - POT_APOTHEM_M
    C = HANDLE_HALF_WIDTH_M * cos_t - STICK_RADIUS_M * n
    rise = math.acos(C / math.hypot(A, B)) - math.atan2(B, A)
    R_pot_ladle = exp3([0.0, 0.0, turn_rad]) @ np.array(
        [
            [0.0, math.sin(rise), math.cos(rise)],
            [-1.0, 0.0, 0.0],
            [0.0, -math.cos(rise), math.sin(rise)],
        ]
    )
    foot = [0.0, HANDLE_HALF_WIDTH_M, -HANDLE_HALF_LENGTH_M]
    p_pot_foot = np.array([-_FOOT_M * cos_t, -_FOOT_M * sin_t, 0.0])
    return make_pose(R_pot_ladle, p_pot_foot - R_pot_ladle @ foot)


def centres_outside_m(T_case_ladle: Array) -> dict[str, float]:
    """How far the middles of handle and scoop are out of the case's cavity [m]; 0 is inside.

    Inside: |x| <= 80 mm, |y| <= 130 mm, z <= 85 mm in the case's frame.
    """
    outside: dict[str, float] = {}
    for part, centre in (("handle", (0.0, 0.0, 0.0)), ("scoop", SCOOP_CENTRE_M)):
        x, y, z = (T_case_ladle @ [*centre, 1.0])[:3].tolist()
        beyond = (abs(x) - CAVITY_HALF_X_M, abs(y) - CAVITY_HALF_Y_M, z - CAVITY_TOP_M)
        outside[part] = math.hypot(*(max(0.0, each) for each in beyond))
    return outside


def is_put_away(T_case_ladle: Array) -> bool:
    """Whether handle and scoop are both in the case."""
    return max(centres_outside_m(T_case_ladle).values()) == 0.0
