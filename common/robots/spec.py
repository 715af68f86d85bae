"""What robot.toml says about a robot, beyond what its MJCF can say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, Self

from annotated_types import Ge, Gt, Le, Len
from pydantic import AfterValidator, BaseModel, ConfigDict, model_validator

from common.messages.base import Name, check_pose

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

Positive = Annotated[float, Gt(0)]
Pose = Annotated[tuple[float, ...], Len(7, 7), AfterValidator(check_pose)]


class JointSpec(BaseModel):
    """One hinge or slide, in the order of the model. Position limits are the MJCF's `range`."""

    model_config = _CONFIG

    name: Name
    velocity_limit: Positive
    """[rad/s, m/s]"""
    acceleration_limit: Positive
    """[rad/s2, m/s2]"""
    stop_acceleration: Positive | None = None
    """How hard a stop brakes it, if not as `acceleration_limit` says [rad/s2, m/s2]."""
    torque_limit: Positive
    """[N m, N]"""
    kp: Positive
    """Position gain of the low-level servo [N m/rad, N/m]."""
    kd: Annotated[float, Ge(0)]
    """Velocity gain of the low-level servo [N m s/rad, N s/m]."""
    start: float
    """Position at the start of an episode: the tool stands at the common start pose [rad, m]."""
    bias: float
    """Posture the last level pulls to [rad, m]."""
    level1_weight: Positive = 1.0
    """Diagonal of H: how unwilling the joint is to move for the hand."""
    level2_weight: Positive = 1.0
    """Diagonal of W: how much the posture cares about the joint."""
    lead_limit: Positive = 0.2
    """How far the commanded position may run ahead of the measured one [rad, m]."""


class LegSpec(BaseModel):
    """A leg that follows the body: its foot stays on its foothold. Not the retargeter's to move."""

    model_config = _CONFIG

    name: Name
    joints: tuple[Name, Name, Name]
    """Hip roll (about x), hip pitch (about y) and knee (about y) in model.xml."""
    foot_site: Name
    """Site of model.xml at the foot's centre."""
    foothold: tuple[float, float, float]
    """Where the foot's centre stands in the world [m]."""


class HeadSpec(BaseModel):
    """A head that keeps its orientation in the world while the body moves."""

    model_config = _CONFIG

    site: Name
    gain_per_s: Positive = 20.0
    """Orientation error to angular velocity."""
    turn_cap_rad_s: Positive = 1.0


class WallSpec(BaseModel):
    """A plane that a site may not cross: normal . (p - point) <= 0, the normal into the wall."""

    model_config = _CONFIG

    name: Name
    site: Name = "tool"
    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    @model_validator(mode="after")
    def _normal_is_a_unit_vector(self) -> Self:
        if abs(math.hypot(*self.normal) - 1.0) > 1e-6:
            raise ValueError(f"normal has length {math.hypot(*self.normal):g}, expected 1")
        return self


class CollisionSpec(BaseModel):
    """Which geoms of model.xml are kept apart."""

    model_config = _CONFIG

    margin_m: Positive = 0.01
    """Distance that is kept [m]."""
    pairs: tuple[tuple[Name, Name], ...] = ()
    """Pairs of the robot's own geoms."""
    obstacle_geoms: tuple[Name, ...] = ()
    """Geoms that are kept off the fixed obstacles of the task (its table)."""


class HandServo(BaseModel):
    """Servo of a free hand that follows poses directly (the Abstract embodiment)."""

    model_config = _CONFIG

    kp_n_per_m: Positive
    kd_n_s_per_m: Annotated[float, Ge(0)]
    force_limit_n: Positive
    kp_nm_per_rad: Positive
    kd_nm_s_per_rad: Annotated[float, Ge(0)]
    torque_limit_nm: Positive
    speed_limit_m_s: Positive
    turn_limit_rad_s: Positive
    acceleration_limit_m_s2: Positive
    """Of its set-point, which waypoints move by leaps; the force limit bounds the hand's own."""
    acceleration_limit_rad_s2: Positive
    stop_acceleration_m_s2: Positive
    """How hard a stop brakes it."""
    stop_acceleration_rad_s2: Positive


class RetargetSpec(BaseModel):
    """Gains of the retargeter (docs/retargeting.md names the symbols)."""

    model_config = _CONFIG

    rotation_scale_m: Positive = 0.3
    """L: metres that one radian of hand error weighs. The pads are 0.27 m ahead of the tool frame:
    that far one radian moves what they hold."""
    hand_gain_per_s: Positive = 100.0
    """K: hand error to hand velocity."""
    hand_speed_cap_m_s: Positive = 1.5
    hand_turn_cap_rad_s: Positive = 3.0
    hand_acceleration_m_s2: Positive = 3.0
    hand_acceleration_rad_s2: Positive = 8.0
    posture_gain_per_s: Positive = 10.0
    """Kb: posture error to joint velocity."""
    wall_gain_per_s: Positive = 5.0
    """xi: distance to a wall or obstacle to the speed of approach."""
    wall_acceleration_m_s2: Positive = 2.0
    """A_c: how hard an approach is braked."""
    setpoint_lead_m: Positive = 0.15
    """How far the set-point may run ahead of the hand."""
    setpoint_lead_rad: Positive = 0.6
    mode: Literal["project", "scale"] = "project"
    """Level 1: as near as possible to the wanted twist, or the largest share of it."""
    solver: str = "piqp"
    """`piqp`, or any other that qpsolvers knows, for comparison."""


class BodyMeshSpec(BaseModel):
    """A body whose primitives are replaced by the meshes of a body of another model."""

    model_config = _CONFIG

    ours: Name
    """Body of model.xml."""
    theirs: Name
    """Body of the other model. Joints of the first one that is paired with `ours` follow ours."""
    T_ours_theirs: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    """Their body's frame in ours: x y z qw qx qy qz."""


class FixedJointSpec(BaseModel):
    """A joint of another model that has no counterpart in ours."""

    model_config = _CONFIG

    joint: Name
    position: float
    """Where it stays [rad, m]."""


class MeshesSpec(BaseModel):
    """Meshes that pictures for people show in place of the robot's primitives."""

    model_config = _CONFIG

    file: Annotated[str, Len(1)]
    """MJCF in the folder of meshes, e.g. `franka_emika_panda/panda_nohand.xml`."""
    group: Annotated[int, Ge(0), Le(5)] = 2
    """Group of that model's visual geoms: 2 in MuJoCo Menagerie."""
    bodies: Annotated[tuple[BodyMeshSpec, ...], Len(1)]
    """The first is the root that all others are compared with."""
    posture: tuple[FixedJointSpec, ...] = ()
    """Joints of the other model that ours lacks; all others that ours lacks stay at zero."""
    keep: tuple[Name, ...] = ()
    """Geoms of replaced bodies that are shown as they are: no mesh stands for them."""


class RobotSpec(BaseModel):
    """A robot. `kind` decides which retargeter and which servo it gets."""

    model_config = _CONFIG

    name: Name
    title: str
    kind: Literal["free_hand", "joints"]
    tool_site: str = "tool"
    """Site of model.xml at the tool frame: +x along the fingers, +z towards the camera."""
    joints: tuple[JointSpec, ...] = ()
    hand: HandServo | None = None
    retarget: RetargetSpec = RetargetSpec()
    legs: tuple[LegSpec, ...] = ()
    head: HeadSpec | None = None
    walls: tuple[WallSpec, ...] = ()
    collision: CollisionSpec = CollisionSpec()
    meshes: MeshesSpec | None = None
    command_latency_s: Annotated[float, Ge(0)] = 0.0
    """From a command to its effect on the robot [s]."""
    T_world_start: Pose = (0.1, -0.3, 0.8, 1.0, 0.0, 0.0, 0.0)
    """Tool pose at the start of an episode, the same for every robot: x y z qw qx qy qz."""
    folder: Path

    @model_validator(mode="after")
    def _kind_has_its_parts(self) -> Self:
        if self.kind == "free_hand" and (self.hand is None or self.joints):
            raise ValueError("a free_hand has a [hand] table and no [[joints]]")
        if self.kind == "joints" and (self.hand is not None or not self.joints):
            raise ValueError("a robot of kind joints has [[joints]] and no [hand] table")
        if self.kind == "free_hand" and self.command_latency_s > 0.0:
            raise ValueError("a free_hand takes commands at once: no command_latency_s")
        return self

    @property
    def model_path(self) -> Path:
        """The robot's MJCF."""
        return self.folder / "model.xml"

    @property
    def nq(self) -> int:
        """Length of `RobotState.positions`. Joints of legs are not counted."""
        return 7 if self.kind == "free_hand" else len(self.joints)

    @property
    def nv(self) -> int:
        """Length of `RobotState.velocities`."""
        return 6 if self.kind == "free_hand" else len(self.joints)

    @property
    def leg_joints(self) -> list[str]:
        """Names of the joints that follow the body."""
        return [joint for leg in self.legs for joint in leg.joints]

    @property
    def start_positions(self) -> list[float]:
        """Joint positions at the start of an episode, as in `RobotState.positions`."""
        if self.kind == "free_hand":
            return list(self.T_world_start)
        return [joint.start for joint in self.joints]
