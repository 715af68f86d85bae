"""What this code knows: robots, tasks and cameras."""

from __future__ import annotations

from dataclasses import dataclass

from common.api import TaskInfo


@dataclass(frozen=True)
class Robot:
    """A robot, with or without a retargeter."""

    name: str
    title: str
    degrees_of_freedom: int


@dataclass(frozen=True)
class Catalog:
    """Names that a request may use, with what is to be shown of them."""

    robots: tuple[Robot, ...]
    tasks: tuple[TaskInfo, ...]
    cameras: tuple[str, ...]

    @property
    def robot_names(self) -> list[str]:
        """Names of the robots."""
        return [robot.name for robot in self.robots]

    @property
    def task_names(self) -> list[str]:
        """Names of the tasks."""
        return [task.name for task in self.tasks]


def load_catalog() -> Catalog:
    """Read the catalog of this installation.

    Raises:
        BadRobotFile: A robot's files cannot be used.
    """
    from common.calibration.loader import list_calibrations
    from common.robots import list_robots, load_robot
    from common.tasks import list_tasks, load_task

    robots = [load_robot(name) for name in list_robots()]
    tasks = [load_task(name) for name in list_tasks()]
    return Catalog(
        robots=tuple(Robot(robot.name, robot.title, robot.nv) for robot in robots),
        tasks=tuple(
            TaskInfo(name=task.name, title=task.title, time_limit_s=task.time_limit_s)
            for task in tasks
        ),
        cameras=tuple(list_calibrations()),
    )
