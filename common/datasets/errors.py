"""Errors of data sets; they belong to the tree of `common.errors`.

StoreError
├─ NoDataset        there is none in the folder
├─ DatasetVersion   written in a format that this code does not read
├─ BadDataset       damaged: what its files say does not agree
├─ OtherDataset     something else is to be appended than what it holds
├─ BadEpisode       an episode that does not fit its columns
├─ DatasetInUse     another process is writing to it
├─ DiskFull         no room for the episode
├─ NotExportable    a data set without what another format needs
└─ BadForeignFile   a file of another format that cannot be imported
"""

from __future__ import annotations

from collections.abc import Sequence

from common.errors import StoreError


class NoDataset(StoreError):
    """A folder without `dataset.json`, or with other files where a data set is to be made."""

    code = "E-NO-DATASET"

    def __init__(self, folder: str, problem: str) -> None:
        self.folder = folder
        self.problem = problem
        super().__init__(
            f"{folder}: {problem}",
            expected="expected a folder that `legato demo record` has written",
            action="check the path",
        )


class DatasetVersion(StoreError):
    """A format or version that this code does not read."""

    code = "E-DATASET-VERSION"

    def __init__(self, folder: str, got: str, readable: Sequence[str]) -> None:
        self.folder = folder
        self.got = got
        self.readable = tuple(readable)
        super().__init__(
            f"{folder} is written as {got}",
            expected=f"readable: {', '.join(readable)}",
            action="use the version of LEGATO that wrote it, or a newer one",
        )


class BadDataset(StoreError):
    """Files that contradict each other."""

    code = "E-DATASET"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"{path}: {problem}",
            expected="expected the files as they were written",
            action="copy the data set again from where it is complete, or record it again",
        )


class OtherDataset(StoreError):
    """What is to be appended has another origin than what is there."""

    code = "E-OTHER-DATASET"

    def __init__(self, folder: str, field: str, has: object, got: object) -> None:
        self.folder = folder
        self.field = field
        self.has = has
        self.got = got
        super().__init__(
            f"{folder} holds {field} {has}, not {got}",
            expected="expected episodes of one origin in one data set",
            action="choose another folder",
        )


class BadEpisode(StoreError):
    """Rows that do not fit the columns of the data set."""

    code = "E-EPISODE"

    def __init__(self, column: str, problem: str, expected: str) -> None:
        self.column = column
        self.problem = problem
        super().__init__(
            f"column {column}: {problem}",
            expected=f"expected {expected}",
            action="nothing was written; correct what makes the episode",
        )


class DatasetInUse(StoreError):
    """Only one process may append."""

    code = "E-DATASET-IN-USE"

    def __init__(self, folder: str) -> None:
        self.folder = folder
        super().__init__(
            f"another process is writing to {folder}",
            expected="expected to be the only one",
            action="wait for it, or choose another folder",
        )


class DiskFull(StoreError):
    """No room for an episode; what was complete before stays readable."""

    code = "E-DISK-FULL"

    def __init__(self, path: str, needed_bytes: int, episodes: int) -> None:
        self.path = path
        self.needed_bytes = needed_bytes
        self.episodes = episodes
        super().__init__(
            f"no room for {needed_bytes / 1e6:.1f} MB on the disk of {path}",
            expected=f"the {episodes} episodes before are complete and stay readable",
            action="make room and run the same command again",
        )


class NotExportable(StoreError):
    """A data set that cannot be written in another format."""

    code = "E-NOT-EXPORTABLE"

    def __init__(self, folder: str, problem: str) -> None:
        self.folder = folder
        self.problem = problem
        super().__init__(
            f"{folder}: {problem}",
            expected="expected episodes with images, action (6 values) and grasp",
            action="look at the data with: legato data view",
        )


class BadForeignFile(StoreError):
    """A file of another format that is damaged, or is not what it is said to be."""

    code = "E-FOREIGN-FILE"

    def __init__(self, path: str, problem: str, expected: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"{path}: {problem}",
            expected=f"expected {expected}",
            action="check the file and the options; the formats are described in docs/data.md",
        )
