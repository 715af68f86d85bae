"""The state of a run on disk, so that it goes on exactly where it was: tensors and numbers only.

`state.safetensors` holds weights and moments, `state.json` the number of updates made and the time
spent. Both are written beside and then put in place.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import torch
from pydantic import BaseModel, ConfigDict, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from services.policy.training.errors import BadRunState
from services.policy.training.trainer import Trainer

_TENSORS, _NUMBERS = "state.safetensors", "state.json"
_WEIGHT, _MOMENT = "weight.", "moment."


class RunState(BaseModel):
    """What is not a tensor."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    update: int = 0
    """Number of updates made."""
    trained_s: float = 0.0
    """Time spent on them."""
    tensors: str = ""
    """Name of the file of this state's tensors."""
    sha256: str = ""
    """Of that file."""


def save_state(folder: Path, trainer: Trainer, state: RunState) -> None:
    """Write the state; the old one stays whole until the new one is."""
    folder.mkdir(parents=True, exist_ok=True)
    tensors = {_WEIGHT + name: value for name, value in trainer.network.state_dict().items()}
    for name, value in _list_moments(trainer).items():
        tensors[_MOMENT + name] = value
    file = folder / f"{state.update}-{_TENSORS}"
    save_file({name: value.contiguous().cpu() for name, value in tensors.items()}, file)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    written = state.model_copy(update={"tensors": file.name, "sha256": digest})
    new = folder / (_NUMBERS + ".new")
    new.write_text(written.model_dump_json(indent=2) + "\n")
    new.replace(folder / _NUMBERS)
    for old in folder.glob(f"*-{_TENSORS}"):
        if old.name != file.name:
            old.unlink()


def load_state(folder: Path, trainer: Trainer) -> RunState:
    """Put a run where it was; a run that has not begun is at update 0.

    Raises:
        BadRunState: A file is damaged or missing.
    """
    numbers = folder / _NUMBERS
    if not numbers.is_file():
        return RunState()
    try:
        state = RunState.model_validate(json.loads(numbers.read_bytes()))
    except (ValueError, ValidationError) as error:
        raise BadRunState(str(numbers), "is not the state of a run") from error
    file = folder / state.tensors
    if not file.is_file() or hashlib.sha256(file.read_bytes()).hexdigest() != state.sha256:
        raise BadRunState(str(file), "is missing or damaged")
    try:
        tensors = load_file(file)
        _put(trainer, tensors)
    except (SafetensorError, KeyError, RuntimeError) as error:
        raise BadRunState(str(file), f"does not fit the network ({error})") from error
    return state


def _list_moments(trainer: Trainer) -> dict[str, torch.Tensor]:
    """Moments of the optimiser, by parameter."""
    moments: dict[str, torch.Tensor] = {}
    for name, parameter in trainer.network.named_parameters():
        for key, value in trainer.optimiser.state.get(parameter, {}).items():
            moments[f"{name}:{key}"] = torch.as_tensor(value)
    return moments


def _put(trainer: Trainer, tensors: dict[str, torch.Tensor]) -> None:
    device = trainer.placement.device
    trainer.network.load_state_dict(
        {n.removeprefix(_WEIGHT): v for n, v in tensors.items() if n.startswith(_WEIGHT)}
    )
    parameters = dict(trainer.network.named_parameters())
    for name, value in tensors.items():
        if not name.startswith(_MOMENT):
            continue
        parameter, key = name.removeprefix(_MOMENT).rsplit(":", 1)
        # AdamW keeps its count of steps on the host.
        placed = value if key == "step" else value.to(device)
        trainer.optimiser.state[parameters[parameter]][key] = placed
