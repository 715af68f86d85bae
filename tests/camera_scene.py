"""A scene for camera tests and benchmarks: table, stove, pot, lid, gripper and a capsule arm.

It stands in for the real world so that the camera can be tested and measured on its own. Figures
follow the lid task: the eyes look down at the lid from 25 cm away, the fingers are in view.
"""

from __future__ import annotations

import itertools
import math

import mujoco
import numpy as np

TOOL_SITE = "tool"
T_WORLD_TOOL = "0.42 -0.22 0.95"


def pot_xml() -> str:
    """A pot with eight wall boxes, a floor and two handles, on a stove."""
    walls = "".join(
        f'<geom type="box" size="0.005 0.0414 0.045" pos="{0.095 * math.cos(a):.6f} '
        f'{0.095 * math.sin(a):.6f} 0.055" euler="0 0 {a:.6f}"/>'
        for a in (math.pi / 4 * k for k in range(8))
    )
    return f"""
    <body name="pot" pos="0.68 0 0.72">
      <freejoint/>
      <geom type="cylinder" size="0.09 0.005" pos="0 0 0.005"/>
      {walls}
      <geom type="box" size="0.043 0.033 0.013" pos="0 0.14 0.08" rgba="0.1 0.1 0.1 1"/>
      <geom type="box" size="0.043 0.033 0.013" pos="0 -0.14 0.08" rgba="0.1 0.1 0.1 1"/>
    </body>"""


def lid_xml() -> str:
    """A lid with a bar on two posts, lying on the table."""
    return """
    <body name="lid" pos="0.63 -0.25 0.70" euler="0 0 0.2">
      <freejoint/>
      <geom type="cylinder" size="0.11 0.005" pos="0 0 0.015" rgba="0.75 0.2 0.15 1"/>
      <geom type="cylinder" size="0.08 0.005" pos="0 0 0.005"/>
      <geom type="box" size="0.005 0.005 0.02" pos="0.04 0 0.05"/>
      <geom type="box" size="0.005 0.005 0.02" pos="-0.04 0 0.05"/>
      <geom type="box" size="0.04 0.013 0.013" pos="0 0 0.07" rgba="0.15 0.15 0.15 1"/>
    </body>"""


def gripper_xml(opening_rad: float) -> str:
    """The gripper in the tool frame: base, two links and two fingers a side (14 geoms)."""
    sides: list[str] = []
    sine, cosine = math.sin(opening_rad), math.cos(opening_rad)
    for s in (1.0, -1.0):
        x, y = 0.09325 + 0.08 * cosine, s * (0.02975 + 0.08 * sine)
        xl, yl = 0.09325 + 0.045 * cosine, s * (0.02975 + 0.045 * sine)
        xu, yu = 0.11425 + 0.040 * cosine, s * (0.00875 + 0.040 * sine)
        turn = f"0 0 {s * opening_rad:.6f}"
        sides += [
            f'<geom type="box" size="0.035 0.008 0.014" pos="{xl} {yl} 0" euler="{turn}"/>',
            f'<geom type="box" size="0.040 0.008 0.010" pos="{xu} {yu} 0" euler="{turn}"/>',
            f'<geom type="box" size="0.027 0.020 0.010" pos="{x + 0.027} {y - s * 0.01} 0"/>',
            f'<geom type="box" size="0.0525 0.008 0.010" pos="{x + 0.11} {y - s * 0.022} 0"/>',
            f'<geom type="box" size="0.0525 0.0015 0.010" pos="{x + 0.11} {y - s * 0.033} 0" '
            'rgba="0.05 0.05 0.05 1"/>',
        ]
    return f"""
      <geom type="cylinder" size="0.05 0.01" pos="0.05 0 0" euler="0 1.5708 0"/>
      <geom type="box" size="0.035 0.043 0.020" pos="0.085 0 0" rgba="0.25 0.25 0.27 1"/>
      <geom type="cylinder" size="0.03 0.02" pos="0.02 0 0" euler="0 1.5708 0"/>
      <geom type="sphere" size="0.04" pos="0 0 0"/>
      {"".join(sides)}"""


def arm_xml() -> str:
    """Fifteen capsules from a base behind the tool to its wrist."""
    points = [
        (-0.20 + 0.58 * t, -0.22 * t, 0.35 + 0.60 * t + 0.5 * math.sin(math.pi * t))
        for t in np.linspace(0.0, 1.0, 16)
    ]
    links = "".join(
        f'<geom type="capsule" size="0.05" fromto="{a[0]} {a[1]} {a[2]} {b[0]} {b[1]} {b[2]}"/>'
        if k < 12
        else f'<body><geom type="capsule" size="0.04" '
        f'fromto="{a[0]} {a[1]} {a[2]} {b[0]} {b[1]} {b[2]}"/></body>'
        for k, (a, b) in enumerate(itertools.pairwise(points))
    )
    return f'<body name="arm">{links}</body>'


def scene_xml(*, opening_rad: float = 0.785, pitch_rad: float = 0.6) -> str:
    """MJCF of the whole scene, about 50 geoms."""
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <default><geom rgba="0.7 0.7 0.72 1"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="4 4 0.1" rgba="0.55 0.5 0.45 1"/>
    <geom name="table" type="box" size="0.5 1 0.025" pos="1 0 0.675" rgba="0.8 0.72 0.6 1"/>
    <geom name="table_leg_1" type="box" size="0.03 0.03 0.325" pos="0.6 0.9 0.325"/>
    <geom name="table_leg_2" type="box" size="0.03 0.03 0.325" pos="0.6 -0.9 0.325"/>
    <geom name="table_leg_3" type="box" size="0.03 0.03 0.325" pos="1.4 0.9 0.325"/>
    <geom name="table_leg_4" type="box" size="0.03 0.03 0.325" pos="1.4 -0.9 0.325"/>
    <body name="stove" pos="0.68 0 0.70">
      <freejoint/>
      <geom type="box" size="0.15 0.12 0.01" pos="-0.03 0 0.01" rgba="0.2 0.2 0.22 1"/>
      <geom type="cylinder" size="0.02 0.0075" pos="-0.14 0.08 0.0275"/>
      <geom type="cylinder" size="0.1 0.001" pos="0 0 0.021" rgba="0.8 0.1 0.1 1"/>
    </body>
    {pot_xml()}
    {lid_xml()}
    {arm_xml()}
    <body name="hand" pos="{T_WORLD_TOOL}" euler="0 {pitch_rad} 0">
      <freejoint/>
      {gripper_xml(opening_rad)}
      <geom type="sphere" size="0.3" rgba="1 1 1 1" group="4"/>
      <geom type="sphere" size="0.3" rgba="1 1 1 0"/>
      <site name="{TOOL_SITE}"/>
    </body>
  </worldbody>
</mujoco>"""


def build_scene(
    *, opening_rad: float = 0.785, pitch_rad: float = 0.6
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Compile the scene and compute its kinematics."""
    xml = scene_xml(opening_rad=opening_rad, pitch_rad=pitch_rad)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data
