"""Errors of shards; they belong to the tree of `common.errors`.

StoreError
├─ NoShards         there are none in the folder
├─ BadShard         damaged: what a file says does not agree with itself
├─ ShardsDiffer     of other requests, versions, code or numbers of shards
├─ ShardsOverlap    two files hold the same trials
├─ ShardsMissing    not all of them are there and complete
└─ ShardInUse       another process is writing to it
LinkError
├─ ShardFailed      a process that ran one has ended with an error
└─ NoRay            no cluster answers at RAY_ADDRESS
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from common.errors import LinkError, StoreError


class NoShards(StoreError):
    """A folder without shards."""

    code = "E-NO-SHARDS"

    def __init__(self, folder: str) -> None:
        self.folder = folder
        super().__init__(
            f"no shards in {folder}",
            expected="expected a folder that was given as --out",
            action="check the path, or run: legato eval --shard 0/N --out FOLDER",
        )


class BadShard(StoreError):
    """A file that contradicts itself."""

    code = "E-SHARD"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"{path}: {problem}",
            expected="expected the file as `legato eval --shard` has written it",
            action="remove the file and run the shard again",
        )


class ShardsDiffer(StoreError):
    """Shards that cannot belong to one evaluation."""

    code = "E-SHARDS-DIFFER"

    def __init__(self, what: str, found: tuple[str, str], expected: tuple[str, str]) -> None:
        self.what = what
        self.found = found
        self.expected_of = expected
        super().__init__(
            f"{found[0]} has {what} {found[1]}",
            expected=f"{expected[0]} has {expected[1]}",
            action="use a folder for each evaluation, and one installation for all of its shards",
        )


class ShardsOverlap(StoreError):
    """Two files with the same shard."""

    code = "E-SHARDS-OVERLAP"

    def __init__(self, shard: str, paths: Sequence[str]) -> None:
        self.shard = shard
        self.paths = tuple(paths)
        super().__init__(
            f"shard {shard} is in {' and in '.join(paths)}",
            expected="expected one file per shard",
            action="remove all of them but one",
        )


class ShardsMissing(StoreError):
    """An evaluation of which some shards have not been run to their end."""

    code = "E-SHARDS-MISSING"

    def __init__(
        self,
        folder: str,
        *,
        count: int,
        absent: Sequence[int],
        unfinished: Mapping[int, tuple[int, int]],
    ) -> None:
        self.folder = folder
        self.count = count
        self.absent = tuple(absent)
        self.unfinished = dict(unfinished)
        told = [f"missing: {as_ranges(absent)}"] if absent else []
        if unfinished:
            trials = (f"{n} ({done} of {total} trials)" for n, (done, total) in unfinished.items())
            told.append(f"not finished: {', '.join(trials)}")
        again = as_ranges(sorted({*absent, *unfinished}))
        super().__init__(
            f"{folder}: of {count} shards are {'; '.join(told)}",
            expected=f"expected 0 to {count - 1}, each with all of its trials",
            action=f"run these again (as a Slurm array: --array={again}); they go on by themselves",
        )


class ShardInUse(StoreError):
    """Two processes want to write one shard."""

    code = "E-SHARD-IN-USE"

    def __init__(self, path: str) -> None:
        self.path = path
        super().__init__(
            f"another process is running the shard {path}",
            expected="expected to be the only one",
            action="wait for it, or stop it; what has ended stays",
        )


class ShardFailed(LinkError):
    """A process that ran a shard for this one."""

    code = "E-SHARD-FAILED"

    def __init__(self, shard: str, exit_code: int) -> None:
        self.shard = shard
        self.exit_code = exit_code
        how = f"killed by signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
        super().__init__(
            f"the process of shard {shard} has ended: {how}",
            expected="expected it to run all of its trials",
            action="look at what it said above",
        )


class NoRay(LinkError):
    """A cluster that is not there."""

    code = "E-NO-RAY"

    def __init__(self, address: str) -> None:
        self.address = address
        super().__init__(
            f"no Ray cluster answers at RAY_ADDRESS={address}",
            expected="expected one, as: ray start --head",
            action="start it, or unset RAY_ADDRESS to use this machine",
        )


def as_ranges(numbers: Sequence[int]) -> str:
    """Sorted numbers with their neighbours joined, e.g. `0-2,5`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1] = [runs[-1][0], number]
        else:
            runs.append([number])
    return ",".join("-".join(map(str, run)) for run in runs)
