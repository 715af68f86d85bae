"""The stove and the pot on it, which the lid and the ladle task share."""

from __future__ import annotations

import math

STOVE_TOP_M = 0.02
"""The stove's plate above the stove's origin; the pot's origin rests on it."""
POT_APOTHEM_M = 0.100
"""From the pot's axis to the outer face of each of its eight walls."""
POT_RIM_M = 0.100
"""The rim above the pot's origin."""


def build_stove() -> str:
    """MJCF of the stove; the scene defines the class `dark`."""
    return """<body name="stove">
      <freejoint/>
      <geom name="stove_plate" class="dark" type="box" size="0.15 0.12 0.01" pos="-0.03 0 0.01"
            mass="1.40"/>
      <geom name="stove_knob" class="dark" type="sphere" size="0.02" pos="-0.14 0.08 0.0275"
            mass="0.04"/>
      <geom name="stove_disc" type="cylinder" size="0.1 0.0004" pos="0 0 0.0201"
            rgba="0.75 0.16 0.10 1" contype="0" conaffinity="0" group="2" mass="0"/>
    </body>"""


def build_pot() -> str:
    """MJCF of the pot; the scene defines the classes `pot` and `dark`."""
    return f"""<body name="pot">
      <freejoint/>
      <geom name="pot_floor" class="pot" type="cylinder" size="0.093 0.005" pos="0 0 0.005"
            mass="0.08"/>
      {_walls()}
      <geom name="pot_handle_0" class="dark" type="box" size="0.043 0.033 0.013"
            pos="0 0.14 0.08" mass="0.0375"/>
      <geom name="pot_handle_1" class="dark" type="box" size="0.043 0.033 0.013"
            pos="0 -0.14 0.08" mass="0.0375"/>
    </body>"""


def _walls() -> str:
    """Eight boxes around the pot's axis: inner apothem 90 mm, rim at 100 mm."""
    walls: list[str] = []
    for i in range(8):
        angle = i * math.pi / 4
        x, y = 0.095 * math.cos(angle), 0.095 * math.sin(angle)
        walls.append(
            f'<geom name="pot_wall_{i}" class="pot" type="box" size="0.005 0.0414 0.045" '
            f'pos="{x:.9f} {y:.9f} 0.055" euler="0 0 {angle:.9f}" mass="0.03"/>'
        )
    return "\n      ".join(walls)
