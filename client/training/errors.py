"""Errors of `legato train`; they belong to the tree of `common.errors`.

ConfigError
└─ NoDemonstrations   there is no data set to train on
"""

from __future__ import annotations

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
