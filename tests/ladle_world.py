"""Worlds of the ladle task whose objects tests place by hand."""

from __future__ import annotations

import mujoco

from common.robots import load_robot
from common.se3 import Array, pose_from_wire, pose_to_wire
from common.tasks import load_task
from services.sim.world import World


def make_ladle_world(robot: str = "abstract", seed: int = 0) -> World:
    return World(task=load_task("ladle"), robot=load_robot(robot), seed=seed)


def put(world: World, name: str, T_world_object: Array) -> None:
    """Place an object by hand, at rest."""
    joint = int(world.model.body(name).jntadr[0])
    start, dof = int(world.model.jnt_qposadr[joint]), int(world.model.jnt_dofadr[joint])
    world.data.qpos[start : start + 7] = pose_to_wire(T_world_object)
    world.data.qvel[dof : dof + 6] = 0.0
    mujoco.mj_forward(world.model, world.data)


def pose(world: World, name: str) -> Array:
    return pose_from_wire(world.object_poses()[name])
