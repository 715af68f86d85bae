"""One file per task. `TASKS` is the list of those that exist."""

from __future__ import annotations

from common.errors import UnknownName
from common.tasks.cup import CupTask
from common.tasks.ladle import LadleTask
from common.tasks.lid import LidTask
from common.tasks.task import Obstacle, Task

_ORIGINAL_CUP = CupTask(
    name="cup-original", title="Shelving the cup (original layout)", layout="original"
)

TASKS: dict[str, Task] = {
    task.name: task for task in (CupTask(), _ORIGINAL_CUP, LadleTask(), LidTask())
}


def list_tasks() -> list[str]:
    """Names of all tasks."""
    return sorted(TASKS)


def load_task(name: str) -> Task:
    """Look a task up by name.

    Raises:
        UnknownName: No such task.
    """
    try:
        return TASKS[name]
    except KeyError:
        raise UnknownName("task", name, list_tasks()) from None


__all__ = ["TASKS", "Obstacle", "Task", "list_tasks", "load_task"]
