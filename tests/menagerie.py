"""A folder laid out as MuJoCo Menagerie is, with a cube on every link.

Names, poses and joints are those of the models that the tables [meshes] in robot.toml refer to:
Menagerie's for Panda, Spot and Google Robot, robosuite's for GR-1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

HALF_M = 0.03

_CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
_SIDES = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))


@dataclass(frozen=True)
class Link:
    """A body, where it is on its parent, and its joint as a name and an axis."""

    name: str
    parent: str
    pos: str = "0 0 0"
    quat: str = "1 0 0 0"
    joint: str = ""
    axis: str = "0 0 1"
    geoms: str = ""
    """Instead of one cube."""


@dataclass(frozen=True)
class Foreign:
    """A model of someone else."""

    file: str
    links: tuple[Link, ...]
    group: int = 2

    def changed(self, name: str, **fields: str) -> Foreign:
        """The same with one link changed."""
        assert any(link.name == name for link in self.links)
        links = (replace(link, **fields) if link.name == name else link for link in self.links)
        return replace(self, links=tuple(links))

    def write(self, root: Path) -> Path:
        """Write it into a folder, with its meshes; returns the folder."""
        path = root / self.file
        (path.parent / "assets").mkdir(parents=True, exist_ok=True)
        (path.parent / "assets" / "cube.obj").write_text(cube_obj())
        path.write_text(self._xml())
        return root

    def _xml(self) -> str:
        return f"""
<mujoco>
  <compiler angle="radian" meshdir="assets" texturedir="assets"/>
  <asset><mesh file="cube.obj"/><material name="white" rgba="0.9 0.9 0.9 1"/></asset>
  <default>
    <geom mass="1"/>
    <default class="visual">
      <geom type="mesh" mesh="cube" material="white" group="{self.group}" contype="0"/>
    </default>
  </default>
  <worldbody>{self._bodies("world")}</worldbody>
</mujoco>"""

    def _bodies(self, parent: str) -> str:
        return "".join(
            f'<body name="{link.name}" pos="{link.pos}" quat="{link.quat}">'
            + (f'<joint name="{link.joint}" axis="{link.axis}"/>' if link.joint else "")
            + (link.geoms or '<geom class="visual"/>')
            + f'<geom type="sphere" size="0.2" group="4"/>{self._bodies(link.name)}</body>'
            for link in self.links
            if link.parent == parent
        )


def cube_obj(half_m: float = HALF_M) -> str:
    """A cube as a Wavefront file."""
    vertices = [f"v {half_m * x} {half_m * y} {half_m * z}" for x, y, z in _CORNERS]
    faces = [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in _SIDES]
    return "\n".join([*vertices, *faces]) + "\n"


def _chain(*links: Link) -> tuple[Link, ...]:
    """Links of which each is the parent of the next."""
    parents = ["world", *(link.name for link in links)]
    return tuple(replace(link, parent=p) for link, p in zip(links, parents, strict=False))


_TURNED, _BACK = "1 1 0 0", "1 -1 0 0"

PANDA = Foreign(
    "franka_emika_panda/panda_nohand.xml",
    _chain(
        Link("link0", ""),
        Link("link1", "", "0 0 0.333", joint="joint1"),
        Link("link2", "", quat=_BACK, joint="joint2"),
        Link("link3", "", "0 -0.316 0", _TURNED, "joint3"),
        Link("link4", "", "0.0825 0 0", _TURNED, "joint4"),
        Link("link5", "", "-0.0825 0.384 0", _BACK, "joint5"),
        Link("link6", "", quat=_TURNED, joint="joint6"),
        Link("link7", "", "0.088 0 0", _TURNED, "joint7"),
    ),
)

_X, _Y = "1 0 0", "0 1 0"


def _spot_leg(name: str, x: float, y: float) -> tuple[Link, ...]:
    return (
        Link(f"{name}_hip", "body", f"{x} {y * 0.055} 0", joint=f"{name}_hx", axis=_X),
        Link(f"{name}_uleg", f"{name}_hip", f"0 {y * 0.1108} 0", joint=f"{name}_hy", axis=_Y),
        Link(f"{name}_lleg", f"{name}_uleg", "0.025 0 -0.32", joint=f"{name}_kn", axis=_Y),
    )


SPOT = Foreign(
    "boston_dynamics_spot/spot_arm.xml",
    (
        Link("body", "world", "0 0 0.75"),
        *_spot_leg("fl", 0.29785, 1.0),
        *_spot_leg("fr", 0.29785, -1.0),
        *_spot_leg("hl", -0.29785, 1.0),
        *_spot_leg("hr", -0.29785, -1.0),
        Link("arm_link_sh0", "body", "0.292 0 0.188", joint="arm_sh0"),
        Link("arm_link_sh1", "arm_link_sh0", joint="arm_sh1", axis=_Y),
        Link("arm_link_hr0", "arm_link_sh1"),
        Link("arm_link_el0", "arm_link_hr0", "0.3385 0 0", joint="arm_el0", axis=_Y),
        Link("arm_link_el1", "arm_link_el0", "0.4033 0 0.075", joint="arm_el1", axis=_X),
        Link("arm_link_wr0", "arm_link_el1", joint="arm_wr0", axis=_Y),
        Link("arm_link_wr1", "arm_link_wr0", joint="arm_wr1", axis=_X),
        Link("arm_link_fngr", "arm_link_wr1", "0.11745 0 0.01482", joint="arm_f1x", axis=_Y),
    ),
)

GOOGLE = Foreign(
    "google_robot/robot.xml",
    _chain(
        Link("base_link", "", "0 0 0.06205"),
        Link("link_torso", "", "0 0 0.5945", joint="joint_torso"),
        Link("link_shoulder", "", "0 -0.167289 0.113", joint="joint_shoulder", axis=_Y),
        Link("link_bicep", "", "0 0.002289 0.215029", joint="joint_bicep"),
        Link("link_elbow", "", "0 -0.064 0.185036", joint="joint_elbow", axis=_Y),
        Link("link_forearm", "", "0 -0.101 0.0914359", joint="joint_forearm"),
        Link("link_wrist", "", "0 -0.00604 0.2735", joint="joint_wrist", axis=_Y),
        Link("link_gripper", "", "0 0.0060384 0.10911", joint="joint_gripper"),
    ),
)


def _gr1_side(s: str, y: float) -> tuple[Link, ...]:
    turn = 0.2164 * -y
    arm = _chain(
        Link("", ""),
        Link(f"{s}_arm_mount", "", f"0 {y * 0.12664} 0.21725", f"0.9763 {-turn} 0 0"),
        Link(f"{s}_upper_arm_pitch", "", joint=f"{s}_shoulder_pitch", axis=_Y),
        Link(
            f"{s}_upper_arm_roll",
            "",
            f"0 {y * 0.067} 0",
            f"0.9763 {turn} 0 0",
            f"{s}_shoulder_roll",
            _X,
        ),
        Link(f"{s}_upper_arm_yaw", "", f"0 {y * 0.04} -0.0575", joint=f"{s}_shoulder_yaw"),
        Link(f"{s}_lower_arm_pitch", "", "0 0 -0.18853", joint=f"{s}_elbow_pitch", axis=_Y),
        Link(f"{s}_hand_yaw", "", "0 0 -0.0405", joint=f"{s}_wrist_yaw"),
        Link(f"{s}_hand_roll", "", "0 0 -0.20153", joint=f"{s}_wrist_roll", axis=_X),
    )[1:]
    leg = _chain(
        Link("", ""),
        Link(
            f"{s}_thigh_roll",
            "",
            f"-0.048 {y * 0.105} -0.0575",
            joint=f"{s}_leg_hip_roll",
            axis=_X,
        ),
        Link(f"{s}_thigh_yaw", "", "0.048 0 -0.0305", joint=f"{s}_leg_hip_yaw"),
        Link(f"{s}_thigh_pitch", "", "0 0 -0.11", joint=f"{s}_leg_hip_pitch", axis=_Y),
        Link(f"{s}_shank_pitch", "", "0 0 -0.36", joint=f"{s}_leg_knee_pitch", axis=_Y),
        Link(f"{s}_foot_pitch", "", "0 0 -0.34", joint=f"{s}_leg_ankle_pitch", axis=_Y),
        Link(f"{s}_foot_roll", "", joint=f"{s}_leg_ankle_roll", axis=_X),
    )[1:]
    return (
        replace(arm[0], parent="torso_waist_roll"),
        *arm[1:],
        replace(leg[0], parent="whole_body"),
        *leg[1:],
    )


GR1 = Foreign(
    "gr1/robot.xml",
    (
        *_chain(
            Link("whole_body", ""),
            Link("torso_waist_yaw", "", "0 0 0.0065", joint="torso_waist_yaw"),
            Link("torso_waist_pitch", "", "0 0 0.055", joint="torso_waist_pitch", axis=_Y),
            Link("torso_waist_roll", "", "0 0 0.085", joint="torso_waist_roll", axis=_X),
        ),
        *_gr1_side("l", 1.0),
        *_gr1_side("r", -1.0),
    ),
    group=1,
)

FOREIGN = {"panda": PANDA, "spot": SPOT, "google": GOOGLE, "gr1": GR1}
