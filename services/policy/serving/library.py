"""The learned policies that a service has in memory, by name."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import policies
from common.errors import InvalidValue, MissingExtra
from common.messages import CheckpointDescription
from services.policy.learning.checkpoint import CONFIG, Checkpoint, load_checkpoint
from services.policy.serving.backend import Backend
from services.policy.serving.decoding import Decoding
from services.policy.serving.learned import LearnedPolicy, Model

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ServingOptions:
    """How networks are run.

    Args:
        backend: Library.
        device: `cpu`, or `cuda:<number>` with torch.
        threads: Passes at the same time, on ONNX Runtime.
        decoding: From a mixture to an action.
    """

    backend: Literal["onnx", "torch"] = "onnx"
    device: str = "cpu"
    threads: int = 1
    decoding: Decoding = "most-likely"


class Library:
    """Loads checkpoints and makes policies of them.

    Args:
        options: How networks are run.
        base: What relative folders are relative to.
    """

    def __init__(self, options: ServingOptions | None = None, *, base: Path | None = None) -> None:
        self._options = options or ServingOptions()
        self._base = base or Path()
        self._models: dict[str, Model] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._models

    def names(self) -> list[str]:
        """What is in memory."""
        return sorted(self._models)

    def describe(self) -> dict[str, CheckpointDescription]:
        """What is in memory, and what it is."""
        return {name: describe_model(self._models[name]) for name in self.names()}

    def load(self, name: str, folder: str | Path) -> None:
        """Load a checkpoint and warm it up; only then does it replace one of the same name.

        Policies that were made before keep the old one.

        Raises:
            CheckpointError: The folder has no usable checkpoint.
            MissingExtra: The backend's library is not installed.
            NoSuchDevice: The device is not there.
        """
        checkpoint = load_checkpoint(self._base / folder)
        backend = open_backend(checkpoint, self._options)
        model = Model(name, checkpoint, backend, self._options.decoding)
        model.warm_up()
        self._models[name] = model
        log.info(
            "policy loaded",
            extra={"policy": name, "sha256": checkpoint.sha256, "runtime": backend.runtime},
        )

    def load_all(self, folders: Mapping[str, Path]) -> None:
        """Load several checkpoints.

        Raises:
            LegatoError: As `load`, of the first that fails.
        """
        for name, folder in folders.items():
            self.load(name, folder.absolute())

    def make_policy(self, name: str) -> LearnedPolicy:
        """A policy for one cell; the name is one of `names`."""
        return self._models[name].make_policy()


def open_backend(checkpoint: Checkpoint, options: ServingOptions) -> Backend:
    """Load a network.

    Raises:
        CheckpointError: It cannot be read.
        InvalidValue: Threads are fewer than 1.
        MissingExtra: The library is not installed.
        NoSuchDevice: The device is not there.
    """
    if options.threads < 1:
        raise InvalidValue("threads", options.threads, "at least 1")
    try:
        if options.backend == "torch":
            from services.policy.serving.torch_backend import TorchBackend

            return TorchBackend(checkpoint, device=options.device)
        from services.policy.serving.onnx_backend import OnnxBackend

        return OnnxBackend(checkpoint, device=options.device, threads=options.threads)
    except ModuleNotFoundError as error:
        extra = "train" if options.backend == "torch" else "policy"
        raise MissingExtra(error.name or options.backend, extra) from error


def describe_model(model: Model) -> CheckpointDescription:
    """What it is, as the bus and REST show it."""
    checkpoint, config = model.checkpoint, model.checkpoint.config
    return CheckpointDescription(
        sha256=checkpoint.sha256,
        folder=str(checkpoint.folder),
        method=config.network.method,
        tasks=list(config.tasks),
        runtime=model.backend.runtime,
        device=model.backend.device,
        decoding=model.decoding,
    )


def find_checkpoints(folder: Path) -> dict[str, Path]:
    """Checkpoints directly below a folder, by their folder's name."""
    return {found.parent.name: found.parent for found in sorted(folder.glob(f"*/{CONFIG}"))}


def find_shipped() -> dict[str, Path]:
    """Checkpoints that come with LEGATO."""
    return find_checkpoints(Path(policies.__file__).parent)
