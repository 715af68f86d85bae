"""What a task is. A task is added by one file that builds a `Task` and one line in `__init__`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, Self

import numpy as np

from common.se3 import Array


@dataclass(frozen=True)
class ObjectState:
    """Pose and velocity of one free object.

    Args:
        T_world_object: (4, 4) pose.
        velocity_m_s: (3,) linear velocity of the origin, world axes.
        velocity_rad_s: (3,) angular velocity, world axes.
    """

    T_world_object: Array
    velocity_m_s: Array
    velocity_rad_s: Array


@dataclass(frozen=True)
class TaskState:
    """All that a success test may look at, at one control tick.

    Args:
        objects: State of every object of the task, by name.
        initial: Their states when the episode started.
        grasp: The grasp command in force (True = close).
        touching_robot: Objects in contact with a gripper or robot geom.
        T_world_pads: (4, 4) poses of the finger pads' centres, axes as the tool's, +x along the
            fingers; none where there is no hand.
    """

    objects: Mapping[str, ObjectState]
    initial: Mapping[str, ObjectState]
    grasp: bool
    touching_robot: frozenset[str]
    T_world_pads: tuple[Array, ...] = ()


@dataclass(frozen=True)
class Judgement:
    """The success test at one tick: which conditions fail, and how far the goal is.

    Args:
        failed_by_hand: Conditions on the hand (grasp, touch, distance) that are not met.
        failed_by_objects: Conditions on where objects are and how they move that are not met.
        goal_distance_m: Distance from the moved object to its goal.
        lost: Why the episode cannot succeed any more, or None.
    """

    failed_by_hand: tuple[str, ...]
    failed_by_objects: tuple[str, ...]
    goal_distance_m: float
    lost: str | None = None

    @classmethod
    def of(
        cls,
        *,
        hand: Mapping[str, bool],
        objects: Mapping[str, bool],
        goal_distance_m: float,
        lost: str | None = None,
    ) -> Self:
        """From all conditions and whether they are met."""
        return cls(_unmet(hand), _unmet(objects), goal_distance_m, lost)

    @property
    def failed(self) -> tuple[str, ...]:
        """Every condition that is not met."""
        return self.failed_by_hand + self.failed_by_objects

    @property
    def placed(self) -> bool:
        """Whether the objects are as they should be, whatever the hand does."""
        return not self.failed_by_objects

    @property
    def holds(self) -> bool:
        """Whether every condition is met."""
        return not self.failed_by_hand and not self.failed_by_objects


def _unmet(conditions: Mapping[str, bool]) -> tuple[str, ...]:
    return tuple([name for name, met in conditions.items() if not met])


@dataclass(frozen=True)
class SpawnedObject:
    """Where an object starts: (4, 4) pose in the world."""

    name: str
    T_world_object: Array


@dataclass(frozen=True)
class Obstacle:
    """A fixed box of the scene that robots keep away from: pose (4, 4) and half sizes."""

    name: str
    T_world_box: Array
    half_size_m: tuple[float, float, float]


@dataclass(frozen=True)
class SceneCamera:
    """A viewpoint for pictures: where the camera is, what it looks at, how wide it sees."""

    position_m: tuple[float, float, float]
    target_m: tuple[float, float, float]
    fovy_deg: float = 45.0


@dataclass(frozen=True)
class Waypoint:
    """One piece of a scripted demonstration, in words the expert understands.

    Args:
        name: For logs.
        T_world_tool: (4, 4) tool pose to reach, or None to stay.
        grasp: Grasp command while moving there.
        speed_m_s: Largest speed on the way.
        turn_rad_s: Largest turning speed on the way.
        wait_s: Time to stay after arriving, for the fingers or for what is held to settle.
        look_s: Time to stay and look; a fluent demonstrator does without.
    """

    name: str
    T_world_tool: Array | None
    grasp: bool
    speed_m_s: float = 0.25
    turn_rad_s: float = 1.2
    wait_s: float = 0.0
    look_s: float = 0.0


@dataclass(frozen=True)
class DemonstratorView:
    """What a demonstrator can see: tool, objects and finger opening, all at one moment."""

    T_world_tool: Array
    objects: Mapping[str, Array]
    opening_m: float


class Script(Protocol):
    """A demonstrator's plan: asked for the next waypoint whenever the last one is done."""

    def next_waypoint(self, view: DemonstratorView) -> Waypoint | None:
        """Next piece of the plan given what is seen now, or None when there is nothing left."""
        ...


class Task(Protocol):
    """One task: scene, spawn, success test, script."""

    @property
    def name(self) -> str:
        """As it is asked for, e.g. `lid`."""
        ...

    @property
    def title(self) -> str:
        """For people, e.g. "Closing the lid"."""
        ...

    @property
    def time_limit_s(self) -> float:
        """Simulated time after which the task has failed [s]."""
        ...

    @property
    def moved_object(self) -> str:
        """The object whose placement is the goal."""
        ...

    @property
    def objects(self) -> tuple[str, ...]:
        """Free bodies of the scene, by body name."""
        ...

    @property
    def scene_camera(self) -> SceneCamera:
        """Viewpoint for pictures."""
        ...

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Fixed boxes that a robot's links must not touch."""
        ...

    def scene_xml(self) -> str:
        """MJCF of table and objects, without any robot. Free bodies carry a free joint."""
        ...

    def spawn(self, random: np.random.Generator) -> list[SpawnedObject]:
        """Draw where the objects start, at rest height plus 0.5 mm."""
        ...

    def judge(self, state: TaskState) -> Judgement:
        """Apply the success test to one tick."""
        ...

    def script(self, random: np.random.Generator) -> Script:
        """A demonstrator's plan with human-like variation."""
        ...


@dataclass(frozen=True)
class SuccessWindow:
    """How long a judgement must hold before it counts: 0.5 s, checked every tick."""

    ticks: int = 50


@dataclass
class SuccessMonitor:
    """Counts ticks in a row for which all conditions hold."""

    window: SuccessWindow = field(default_factory=SuccessWindow)
    held: int = 0
    smallest_distance_m: float = float("inf")
    last: Judgement | None = None

    def update(self, judgement: Judgement) -> bool:
        """Take one tick's judgement; tell whether success is reached."""
        self.last = judgement
        self.smallest_distance_m = min(self.smallest_distance_m, judgement.goal_distance_m)
        self.held = self.held + 1 if judgement.holds else 0
        return self.held >= self.window.ticks
