"""One world: a task's scene, a robot holding the gripper, servos, and a clean start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from common.calibration.four_bar import GRIPPER_MODEL
from common.errors import BadRobotFile
from common.messages.base import LARGEST_JOINT_VALUE
from common.robots import RobotSpec
from common.se3 import Array, make_pose, pose_to_wire
from common.tasks import Task
from common.tasks.task import ObjectState, TaskState
from services.sim.fingers import Fingers
from services.sim.legs import Legs
from services.sim.servo import HandServos, JointServos, Servos

PHYSICS_DT_S = 0.002
SETTLE_S = 1.0
SLEEP_TOLERANCE = 1e-3
"""Objects slower than this (MuJoCo's scaled velocity, m/s) may fall asleep."""
TOOL_SITE = "gripper_tool"
"""The tool frame in the compiled world, whatever robot carries it."""
PADS = ("gripper_left_pad", "gripper_right_pad")
"""The geoms that hold objects."""


@dataclass(frozen=True)
class _Body:
    """Where one free object lives in MuJoCo's arrays."""

    name: str
    body_id: int
    qpos: int
    dof: int


class World:
    """A compiled model and its state. Built anew for every episode, so nothing can carry over.

    Args:
        task: Scene, spawn and success test.
        robot: Which robot carries the gripper.
        seed: Draws where the objects start; the same for every robot and policy.
    """

    def __init__(self, *, task: Task, robot: RobotSpec, seed: int) -> None:
        self.task = task
        self.robot = robot
        self.model = _build_spec(task, robot).compile()
        self.data = mujoco.MjData(self.model)
        self._tool = self.model.site(TOOL_SITE).id
        self._pads = [self.model.geom(name).id for name in PADS]
        self._objects = tuple(_find_body(self.model, name) for name in task.objects)
        self._objects_qpos = np.concatenate([b.qpos + np.arange(7) for b in self._objects])
        self._objects_dof = np.concatenate([b.dof + np.arange(6) for b in self._objects])
        self._object_of_geom, self._is_robot_geom = self._classify_geoms()
        self.servos: Servos = (
            HandServos(self.model, robot)
            if robot.hand is not None
            else JointServos(self.model, robot)
        )
        self.fingers = Fingers(self.model)
        self._legs = Legs(self.model, robot)
        self._known: tuple[bytes, dict[str, ObjectState]] = b"", {}
        self._place(seed)
        self._settle()
        self.initial = self.object_states()

    def advance(self, ticks_s: float) -> None:
        """Step physics for one control tick, servo set-points moving linearly over it."""
        substeps = round(ticks_s / PHYSICS_DT_S)
        self.fingers.apply(self.data)
        self.servos.start_tick(substeps)
        for substep in range(substeps):
            self.servos.apply(self.data, substep)
            mujoco.mj_step(self.model, self.data)
        # Poses of the state just reached, not of the one before it.
        self.update_poses(self.data)

    def update_poses(self, data: Any) -> None:
        """Bring all poses up to date with the joint positions of a state of this world.

        Raises:
            FootholdOutOfReach: The body is where a foot cannot stand on its foothold.
        """
        mujoco.mj_kinematics(self.model, data)
        self._legs.follow(data)

    def show(
        self, positions: Sequence[float], opening_m: float, objects: Mapping[str, Sequence[float]]
    ) -> None:
        """Take on a recorded state, for pictures: poses only, nothing moves.

        Args:
            positions: Of the robot, as in `RobotState`.
            opening_m: Distance between the finger pads.
            objects: Name -> T_world_object as in `GroundTruth`, for every object.
        """
        for body in self._objects:
            self.data.qpos[body.qpos : body.qpos + 7] = objects[body.name]
        self.servos.place(self.data, positions)
        self.fingers.place(self.data, opening_m)
        self.update_poses(self.data)

    @property
    def T_world_tool(self) -> Array:
        """Measured tool pose, (4, 4)."""
        return make_pose(
            self.data.site_xmat[self._tool].reshape(3, 3), self.data.site_xpos[self._tool]
        )

    def object_poses(self) -> dict[str, list[float]]:
        """Pose of every object, as it travels in `GroundTruth`."""
        return {body.name: pose_to_wire(self._pose(body)) for body in self._objects}

    def object_states(self) -> dict[str, ObjectState]:
        """Pose and velocity of every object, as they were told last while nothing moves."""
        data = self.data
        now = data.qpos[self._objects_qpos].tobytes() + data.qvel[self._objects_dof].tobytes()
        if now != self._known[0]:
            self._known = now, self._measure_objects()
        return self._known[1]

    def _measure_objects(self) -> dict[str, ObjectState]:
        states: dict[str, ObjectState] = {}
        for body in self._objects:
            T_world_object = self._pose(body)
            velocity = self.data.qvel[body.dof : body.dof + 6]
            # A free joint's angular velocity is in body axes.
            states[body.name] = ObjectState(
                T_world_object, velocity[:3].copy(), T_world_object[:3, :3] @ velocity[3:]
            )
        return states

    def task_state(self, *, grasp: bool) -> TaskState:
        """All that the success test may look at."""
        return TaskState(
            objects=self.object_states(),
            initial=self.initial,
            grasp=grasp,
            touching_robot=self._touching_robot(),
            T_world_pads=self._place_pads(),
        )

    def is_bounded(self) -> bool:
        """Whether the state still is one: finite, and within what messages may carry."""
        q, v = self.data.qpos, self.data.qvel
        # The sum of squares bounds each of them, and settles it nearly always.
        if q.dot(q) + v.dot(v) <= LARGEST_JOINT_VALUE**2:
            return True
        return all(
            bool((np.abs(values) <= LARGEST_JOINT_VALUE).all())
            for values in (self.data.qpos, self.data.qvel)
        )

    def _pose(self, body: _Body) -> Array:
        return make_pose(self.data.xmat[body.body_id].reshape(3, 3), self.data.xpos[body.body_id])

    def _place_pads(self) -> tuple[Array, ...]:
        # Fingers do not turn against the tool.
        R_world_tool = self.data.site_xmat[self._tool].reshape(3, 3)
        return tuple(make_pose(R_world_tool, self.data.geom_xpos[pad]) for pad in self._pads)

    def _touching_robot(self) -> frozenset[str]:
        if self.data.ncon == 0:
            return frozenset()
        pairs = self.data.contact.geom
        touching: set[str] = set()
        for geom_1, geom_2 in pairs.tolist():
            if self._is_robot_geom[geom_1] and self._object_of_geom[geom_2] is not None:
                touching.add(str(self._object_of_geom[geom_2]))
            elif self._is_robot_geom[geom_2] and self._object_of_geom[geom_1] is not None:
                touching.add(str(self._object_of_geom[geom_1]))
        return frozenset(touching)

    def _classify_geoms(self) -> tuple[list[str | None], list[bool]]:
        names = {body.body_id: body.name for body in self._objects}
        body_of_geom = self.model.geom_bodyid.tolist()
        objects = [names.get(int(self.model.body_rootid[body])) for body in body_of_geom]
        robot = [
            self.model.body(body).name.startswith(("robot_", "gripper_")) for body in body_of_geom
        ]
        return objects, robot

    def _place(self, seed: int) -> None:
        """Put objects where the seed says, the robot at its start, the fingers open."""
        mujoco.mj_resetData(self.model, self.data)
        spawned = self.task.spawn(np.random.default_rng([seed, 0]))
        addresses = {body.name: body.qpos for body in self._objects}
        for item in spawned:
            start = addresses[item.name]
            self.data.qpos[start : start + 7] = pose_to_wire(item.T_world_object)
        self.servos.reset(self.data)
        self.fingers.reset(self.data)
        self.update_poses(self.data)
        mujoco.mj_forward(self.model, self.data)

    def _settle(self) -> None:
        """Let objects come to rest before the clock starts."""
        self.advance(SETTLE_S)
        self.data.time = 0.0


def _build_spec(task: Task, robot: RobotSpec) -> Any:
    spec = mujoco.MjSpec.from_string(task.scene_xml())
    robot_spec = mujoco.MjSpec.from_file(str(robot.model_path))
    gripper_spec = mujoco.MjSpec.from_file(str(GRIPPER_MODEL))
    spec.attach(robot_spec, frame=spec.worldbody.add_frame(), prefix="robot_")
    tool = spec.site(f"robot_{robot.tool_site}")
    if tool is None:
        raise BadRobotFile(robot.name, "model.xml", f"there is no site {robot.tool_site!r}")
    spec.attach(gripper_spec, site=tool, prefix="gripper_")
    option = spec.option
    option.timestep = PHYSICS_DT_S
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 10.0
    # MuJoCo 4.0.0 has a wrong Hessian with a sparse Jacobian, which `auto` picks for large worlds.
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # What lies still costs nothing until something touches it: halves the cost of a step.
    option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    option.sleep_tolerance = SLEEP_TOLERANCE
    if robot.hand is not None:
        HandServos.add_actuators(spec, robot.hand)
    else:
        JointServos.add_actuators(spec, robot)
    Fingers.add_actuators(spec)
    Legs.fix(spec, robot)
    return spec


def _find_body(model: Any, name: str) -> _Body:
    body = model.body(name)
    joint = model.joint(int(body.jntadr[0]))
    return _Body(name, int(body.id), int(joint.qposadr[0]), int(joint.dofadr[0]))
