"""Errors of training; they belong to the tree of `common.errors`.

ConfigError
├─ BadTrainingData    a data set that this network cannot be trained on
└─ OtherRun           the folder holds a run with another config
StoreError
└─ BadRunState        what is needed to go on is damaged
"""

from __future__ import annotations

from common.errors import ConfigError, StoreError


class BadTrainingData(ConfigError):
    """A data set that cannot be trained on."""

    code = "E-TRAINING-DATA"

    def __init__(self, where: str, got: str, expected: str) -> None:
        self.where = where
        self.got = got
        super().__init__(
            f"{where}: {got}",
            expected=f"expected {expected}",
            action="look at the data with: legato data view",
        )


class OtherRun(ConfigError):
    """A folder in which something else is being trained."""

    code = "E-OTHER-RUN"

    def __init__(self, folder: str, field: str, theirs: object, ours: object) -> None:
        self.folder = folder
        self.field = field
        super().__init__(
            f"{folder} holds a run with {field} {theirs}, asked for is {ours}",
            expected="to go on, everything but the output must be the same",
            action="choose another folder with --out",
        )


class BadRunState(StoreError):
    """A damaged state of a run."""

    code = "E-RUN-STATE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        super().__init__(
            f"{path}: {problem}",
            expected="expected the state that `legato train` has written",
            action="remove the folder to start anew, or choose another one with --out",
        )
