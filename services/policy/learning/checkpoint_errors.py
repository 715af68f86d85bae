"""Errors of checkpoints; they belong to the tree of `common.errors`.

ConfigError
├─ CheckpointError
│  ├─ NoCheckpoint            the folder or one of its files is missing
│  ├─ MissingStatistics       without them actions have no unit
│  ├─ UnsupportedCheckpoint   another schema or another convention of actions
│  ├─ DamagedCheckpoint       files that are not what was saved
│  ├─ ShapesDiffer            weights or a graph of another network
│  └─ ExportDiffers           the graph does not say what the network says
├─ WrongImageSize             a frame that is not the camera's
└─ NoSuchDevice               not in this machine, or not usable by this installation
"""

from __future__ import annotations

from collections.abc import Sequence

from common.errors import ConfigError


class CheckpointError(ConfigError):
    """A checkpoint that cannot be used."""

    code = "E-CHECKPOINT"


class NoCheckpoint(CheckpointError):
    """A folder that is not there, or lacks a file."""

    code = "E-NO-CHECKPOINT"

    def __init__(self, folder: str, missing: str) -> None:
        self.folder = folder
        self.missing = missing
        super().__init__(
            f"{folder}: there is no {missing}",
            expected="expected a folder that `legato train` has written",
            action="check the path on the machine where the policy service runs",
        )


class MissingStatistics(CheckpointError):
    """A checkpoint without the statistics of its actions."""

    code = "E-MISSING-STATISTICS"

    def __init__(self, folder: str) -> None:
        self.folder = folder
        super().__init__(
            f"{folder}: there is no stats.json",
            expected="expected the statistics of the actions that it was trained on: without them "
            "what the network says has no unit",
            action="copy the whole folder that was saved; statistics cannot be made up",
        )


class UnsupportedCheckpoint(CheckpointError):
    """A schema or a convention that this code does not follow."""

    code = "E-CHECKPOINT-SCHEMA"

    def __init__(self, folder: str, what: str, got: object, expected: str) -> None:
        self.folder = folder
        self.what = what
        self.got = got
        super().__init__(
            f"{folder}: its {what} is {got!r}",
            expected=f"expected {expected}",
            action="use the version of LEGATO that wrote it, or train again",
        )


class DamagedCheckpoint(CheckpointError):
    """Files that are not what was saved."""

    code = "E-CHECKPOINT-DAMAGED"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"{path}: {problem}",
            expected="expected what was saved, byte for byte",
            action="copy the checkpoint again from where it was trained",
        )


class ShapesDiffer(CheckpointError):
    """Numbers that do not fit the network of the checkpoint's own config."""

    code = "E-CHECKPOINT-SHAPE"

    def __init__(self, path: str, what: str, expected: str, got: str) -> None:
        self.path = path
        self.what = what
        self.expected_shape = expected
        self.got_shape = got
        super().__init__(
            f"{path}: {what} is {got}",
            expected=f"expected {expected}, from config.json",
            action="keep the files of one checkpoint together",
        )


class ExportDiffers(CheckpointError):
    """A graph that does not say what the network says."""

    code = "E-EXPORT"
    http_status = 500

    def __init__(self, output: str, difference: float, tolerance: float) -> None:
        self.output = output
        self.difference = difference
        self.tolerance = tolerance
        super().__init__(
            f"the exported graph's {output} differs from the network's by {difference:.2g}",
            expected=f"expected at most {tolerance:.0e}",
            action="report it; no checkpoint was written",
        )


class WrongImageSize(ConfigError):
    """A frame of another size than the camera's."""

    code = "E-IMAGE-SIZE"

    def __init__(self, width: int, height: int, expected_px: int) -> None:
        self.width = width
        self.height = height
        self.expected_px = expected_px
        super().__init__(
            f"the stereo frame has {width} x {height} pixels",
            expected=f"expected {expected_px} x {expected_px}, as in training",
            action="choose a camera of that size",
        )


class NoSuchDevice(ConfigError):
    """A device that networks cannot run on here."""

    code = "E-DEVICE"

    def __init__(self, device: str, available: Sequence[str]) -> None:
        self.device = device
        self.available = tuple(available)
        super().__init__(
            f'there is no device "{device}" for networks here',
            expected=f"available: {', '.join(available)}",
            action="choose another --device, or look at the driver and the installation",
        )
