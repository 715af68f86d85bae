"""Everything a training run depends on beside the network: one typed config."""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeAlias

from annotated_types import Ge, Gt, Le, Lt
from pydantic import Field, model_validator

from services.policy.learning.config import Config, PolicyConfig, Positive

Precision: TypeAlias = Literal["bf16", "fp32"]


class OptimiserConfig(Config, frozen=True):
    """AdamW; the rate rises linearly, then falls to zero as half a cosine."""

    learning_rate: Annotated[float, Gt(0)] = 7e-4
    warmup_steps: Annotated[int, Ge(0)] = 50
    weight_decay: Annotated[float, Ge(0)] = 1e-4
    clip_norm: Annotated[float, Gt(0)] = 10.0


class AugmentationConfig(Config, frozen=True):
    """What is varied in the images of a window, the same for all its frames and both eyes."""

    shift_px: Annotated[int, Ge(0), Le(32)] = 1
    """Largest shift, in pixels of the camera's 128: how well a camera is mounted. Where something
    is in the image is how far it is from the fingers; a pixel is 10 mm there."""
    brightness: Annotated[float, Ge(0), Lt(1)] = 0.1
    """Largest change of the gray level, as a share of white."""
    contrast: Annotated[float, Ge(0), Lt(1)] = 0.15
    """Largest change of the distance from middle gray, as a share."""


class PretrainingConfig(Config, frozen=True):
    """Encoders alone, on single frames drawn from everywhere, by the loss of the future.

    Windows are rows of nearly equal pictures, and in the beginning the mixture sends noise through
    the encoders: this way they see within a tenth of the frames.
    """

    frames: Positive = 80_000
    batch_frames: Positive = 160
    learning_rate: Annotated[float, Gt(0)] = 1e-3

    @property
    def updates(self) -> int:
        """Optimiser steps."""
        return max(1, self.frames // self.batch_frames)


class TrainingConfig(Config, frozen=True):
    """A run: network, budget, data treatment."""

    network: PolicyConfig = Field(discriminator="method")
    pretraining: PretrainingConfig | None = None
    """None where the network has no loss of the future."""
    timesteps: Positive = 1_000_000
    """Budget in frames of all windows, repetitions included."""
    batch_windows: Positive = 16
    """Windows per update, over all processes."""
    optimiser: OptimiserConfig = OptimiserConfig()
    augmentation: AugmentationConfig = AugmentationConfig()
    precision: Precision = "bf16"
    grasp_lead_steps: Annotated[int, Ge(0), Le(20)] = 2
    """Steps by which grasp labels come early: against waiting for ever before a change."""
    validation_share: Annotated[float, Ge(0), Lt(1)] = 0.05
    """Of the episodes, the last ones; none of them is trained on."""
    longest_episode_s: Annotated[float, Gt(0)] = 30.0
    """Longer demonstrations are left out: they show retries above all."""
    seed: Annotated[int, Ge(0)] = 0

    @property
    def updates(self) -> int:
        """Optimiser steps of the whole network, after those of the encoders."""
        return max(1, self.timesteps // (self.batch_windows * self.network.window))

    @model_validator(mode="after")
    def _pretraining_has_a_loss(self) -> Self:
        if self.pretraining is not None and self.network.loss.future is None:
            raise ValueError("pretraining needs the network's loss of the future")
        return self
