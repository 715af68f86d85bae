"""A trained policy as a folder: weights, graph, config, statistics, card. No pickle.

| file | what |
|---|---|
| `model.safetensors` | weights |
| `model.onnx` | graph for ONNX Runtime; its weights are those of `model.safetensors` |
| `config.json` | `CheckpointConfig` |
| `stats.json` | `ActionStatistics` |
| `card.json` | `CheckpointCard`, and the hashes |
| `README.md` | the card for people |

The hash of a checkpoint is that of its weights, config and statistics. This module does without
torch, except for saving.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar

from annotated_types import Len
from pydantic import BaseModel, ValidationError

from common.errors import InvalidValue, NotWritable
from services.policy.learning.checkpoint_card import (
    CheckpointCard,
    DatasetSummary,
    EvaluationRow,
    format_readme,
)
from services.policy.learning.checkpoint_config import (
    ACTION_CONVENTION,
    SCHEMA_VERSION,
    CheckpointConfig,
    GraspHysteresis,
    ImageSpec,
)
from services.policy.learning.checkpoint_errors import (
    DamagedCheckpoint,
    MissingStatistics,
    NoCheckpoint,
    UnsupportedCheckpoint,
)
from services.policy.learning.config import Config
from services.policy.learning.normalization import ActionStatistics

if TYPE_CHECKING:
    from services.policy.learning.network import PolicyNetwork

__all__ = [
    "ACTION_CONVENTION",
    "SCHEMA_VERSION",
    "Checkpoint",
    "CheckpointCard",
    "CheckpointConfig",
    "DatasetSummary",
    "EvaluationRow",
    "GraspHysteresis",
    "ImageSpec",
    "load_checkpoint",
    "save_checkpoint",
    "with_evaluation",
]

WEIGHTS = "model.safetensors"
GRAPH = "model.onnx"
CONFIG = "config.json"
STATISTICS = "stats.json"
CARD = "card.json"
README = "README.md"

_HASHED = (WEIGHTS, CONFIG, STATISTICS)

Sha256: TypeAlias = Annotated[str, Len(64, 64)]
Model = TypeVar("Model", bound=BaseModel)


class _Record(Config, frozen=True):
    """`card.json`."""

    sha256: Sha256
    graph_sha256: Sha256
    card: CheckpointCard


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint whose files are what was saved. The weights stay on disk.

    Args:
        folder: Where it is.
        sha256: Hash over weights, config and statistics.
        config: Everything that deployment depends on.
        statistics: Units of its actions.
        card: Where it comes from and what it can do.
    """

    folder: Path
    sha256: str
    config: CheckpointConfig
    statistics: ActionStatistics
    card: CheckpointCard


def save_checkpoint(
    folder: Path,
    network: PolicyNetwork,
    *,
    config: CheckpointConfig,
    statistics: ActionStatistics,
    card: CheckpointCard,
) -> str:
    """Write a checkpoint; whoever reads finds the old one or the new one, never a part.

    The network is left as it is, and so are the global random generators.

    Args:
        folder: Where it goes; an older checkpoint there is replaced.
        network: With the weights to save, on any device.
        config: `config.network` is the network's own config.
        statistics: Of the actions that it was trained on.
        card: How it was made.

    Returns:
        The hash of the checkpoint.

    Raises:
        ExportDiffers: The graph does not say what the network says.
        InvalidValue: The config is another network's, or the folder holds something else.
        MissingExtra: The packages of the extra `train` are not installed.
        NotWritable: The folder cannot be written.
    """
    from services.policy.learning.checkpoint_weights import write_weights
    from services.policy.learning.onnx_export import export_graph

    if config.network != network.config:
        raise InvalidValue("config.network", config.network, "the config of the network itself")
    if folder.exists() and not (folder / CONFIG).exists():
        raise InvalidValue("folder", str(folder), "a checkpoint or a path that does not exist")
    with _replacing(folder) as work:
        write_weights(work / WEIGHTS, network)
        _write(work / CONFIG, config)
        _write(work / STATISTICS, statistics)
        export_graph(work / GRAPH, work / WEIGHTS, network)
        record = _Record(sha256=_hash(work), graph_sha256=_hash_file(work / GRAPH), card=card)
        _write(work / CARD, record)
        _write_readme(work, folder.name, record, config=config, statistics=statistics)
    return record.sha256


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read a checkpoint and check that its files are what was saved.

    Raises:
        DamagedCheckpoint: A hash differs, or a file cannot be read.
        MissingStatistics: There is no `stats.json`.
        NoCheckpoint: There is no folder, or another file is missing.
        UnsupportedCheckpoint: Another schema or another convention of actions.
    """
    _check_files(folder)
    _check_schema(folder)
    config = _read(folder / CONFIG, CheckpointConfig)
    statistics = _read(folder / STATISTICS, ActionStatistics)
    record = _read(folder / CARD, _Record)
    for name, got, expected in (
        (f"{', '.join(_HASHED)}", _hash(folder), record.sha256),
        (GRAPH, _hash_file(folder / GRAPH), record.graph_sha256),
    ):
        if got != expected:
            problem = f"the hash of {name} is {got[:12]}, {CARD} says {expected[:12]}"
            raise DamagedCheckpoint(str(folder), problem)
    return Checkpoint(folder, record.sha256, config, statistics, record.card)


def with_evaluation(folder: Path, rows: Iterable[EvaluationRow]) -> Checkpoint:
    """Give a checkpoint's card a table of evaluations, in place of the one it has.

    Its hash stays, because the policy does.

    Returns:
        The checkpoint as it is now.

    Raises:
        NotWritable: The folder cannot be written.
        LegatoError: As `load_checkpoint`.
    """
    before = load_checkpoint(folder)
    card = before.card.model_copy(update={"evaluations": tuple(rows)})
    record = _read(folder / CARD, _Record).model_copy(update={"card": card})
    try:
        _write(folder / CARD, record)
        _write_readme(
            folder, folder.name, record, config=before.config, statistics=before.statistics
        )
    except OSError as error:
        raise NotWritable(str(folder), error.strerror or str(error)) from error
    return load_checkpoint(folder)


@contextmanager
def _replacing(folder: Path) -> Generator[Path, None, None]:
    """A new folder beside one, which takes its place when all went well."""
    target = folder.absolute()
    work = target.with_name(f".{target.name}-{secrets.token_hex(4)}")
    try:
        work.mkdir(parents=True)
        yield work
        if target.exists():
            aside = work.with_name(f"{work.name}-old")
            target.rename(aside)
            work.rename(target)
            shutil.rmtree(aside)
        else:
            work.rename(target)
    except OSError as error:
        raise NotWritable(str(folder), error.strerror or str(error)) from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _write(path: Path, model: BaseModel) -> None:
    _write_text(path, model.model_dump_json(indent=2) + "\n")


def _write_text(path: Path, text: str) -> None:
    """Write a whole file or nothing."""
    work = path.with_name(f".{path.name}-{secrets.token_hex(4)}")
    try:
        with work.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        work.replace(path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            work.unlink()


def _write_readme(
    folder: Path,
    name: str,
    record: _Record,
    *,
    config: CheckpointConfig,
    statistics: ActionStatistics,
) -> None:
    text = format_readme(
        name, record.sha256, config=config, statistics=statistics, card=record.card
    )
    _write_text(folder / README, text)


def _check_files(folder: Path) -> None:
    if not folder.is_dir():
        raise NoCheckpoint(str(folder), "folder of that name")
    if not (folder / CONFIG).is_file():
        raise NoCheckpoint(str(folder), CONFIG)
    if not (folder / STATISTICS).is_file():
        raise MissingStatistics(str(folder))
    for name in (WEIGHTS, GRAPH, CARD):
        if not (folder / name).is_file():
            raise NoCheckpoint(str(folder), name)


def _check_schema(folder: Path) -> None:
    """Refuse what another version wrote, before its fields are judged."""
    try:
        said: Any = json.loads((folder / CONFIG).read_bytes())
    except ValueError as error:
        raise DamagedCheckpoint(str(folder / CONFIG), f"not JSON: {error}") from error
    if not isinstance(said, dict):
        raise DamagedCheckpoint(str(folder / CONFIG), "not an object")
    for what, field, known in (
        ("schema", "schema_version", SCHEMA_VERSION),
        ("action convention", "action", ACTION_CONVENTION),
    ):
        if said.get(field) != known:
            raise UnsupportedCheckpoint(str(folder), what, said.get(field), repr(known))


def _read(path: Path, kind: type[Model]) -> Model:
    try:
        return kind.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise DamagedCheckpoint(str(path), f"{where}: {first['msg']}") from error


def _hash(folder: Path) -> str:
    lines = (f"{name} {_hash_file(folder / name)}\n" for name in _HASHED)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _hash_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
