"""Errors of `legato train`; they belong to the tree of `common.errors`.

ConfigError
├─ NoDemonstrations   there is no data set to train on
└─ OtherTask          the demonstrations are of another task
"""

from __future__ import annotations

from collections.abc import Sequence

from common.errors import ConfigError


class NoDemonstrations(ConfigError):
    """No data set where it is looked for."""

    code = "E-NO-DEMONSTRATIONS"

    def __init__(self, folder: str, task: str) -> None:
        self.folder = folder
        self.task = task
        super().__init__(
            f"there are no demonstrations in {folder}",
            expected="expected the folder of a data set",
            action=f"record some with: legato demo record --task {task}",
        )


class OtherTask(ConfigError):
    """Demonstrations of another task than the policy is to be trained for."""

    code = "E-OTHER-TASK"

    def __init__(self, task: str, found: Sequence[str]) -> None:
        self.task = task
        self.found = tuple(found)
        super().__init__(
            f"the demonstrations are of {', '.join(found)}",
            expected=f"expected {task}",
            action="choose other data with --data, or the task with --task",
        )
