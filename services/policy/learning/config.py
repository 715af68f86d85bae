"""What a learned policy is: network, action head and losses, one typed config per method.

`legato` is the method of the paper, `legato-se3` the same without invariants, `bc-rnn` one mixture
over pose and grasp. Everything a run depends on is a field here, so a checkpoint that stores its
config stores all of it.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeAlias

from annotated_types import Ge, Gt, Le, Len, Lt, MultipleOf
from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive: TypeAlias = Annotated[int, Ge(1)]
Weight: TypeAlias = Annotated[float, Ge(0)]
Small: TypeAlias = Annotated[float, Gt(0)]


class Config(BaseModel, frozen=True):
    """Typed, frozen, no unknown keys."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class EncoderConfig(Config, frozen=True):
    """One eye: ResNet18, key points by spatial softmax, one linear layer."""

    width: Annotated[int, Ge(4), MultipleOf(4)] = 64
    """Channels of the first stage; the stages have w, 2w, 4w, 8w."""
    input_px: Literal[64, 128] = 128
    """Side of the image; 64 is the 2x2 mean of the camera's 128."""
    fold: Literal[1, 2] = 1
    """2 = the first convolution takes 2x2 neighbours as four channels, so that a network of half
    the side sees every pixel."""
    stages: Literal[3, 4] = 4
    """Of the ResNet18; three leave out the last, which costs most on a fine map."""
    blocks: Literal[1, 2] = 2
    """Of each stage; one makes it the ResNet10."""
    map_px: Literal[2, 4, 8, 16] = 4
    """Side of the last feature map: the last stages keep their resolution until it fits."""
    keypoints: Positive = 32
    keypoint_batchnorm: bool = False
    features: Positive = 64

    @property
    def halving_stages(self) -> int:
        """How many of the stages after the first halve the map; the stem divides by 4."""
        return (self.input_px // self.fold // self.map_px).bit_length() - 3

    @model_validator(mode="after")
    def _map_is_reachable(self) -> Self:
        side = self.input_px // self.fold
        coarsest, finest = side >> (self.stages + 1), side >> 2
        if not coarsest <= self.map_px <= finest:
            raise ValueError(f"map_px is {self.map_px}, not within {coarsest} to {finest}")
        return self


class HistoryConfig(Config, frozen=True):
    """The previous actions as an input of the network."""

    steps: Annotated[int, Ge(0)] = 2
    """T; 0 = the network sees images only."""
    dropout: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Share of training windows whose history is hidden."""


class LstmConfig(Config, frozen=True):
    """Recurrent part."""

    layers: Positive = 2
    width: Positive = 400


class MlpConfig(Config, frozen=True):
    """Layers between LSTM and heads."""

    layers: Positive = 3
    width: Positive = 2048
    layer_norm: bool = False
    """Normalise each layer before its ReLU: without, many units die in short trainings."""
    sees_images: bool = False
    """Give the first layer the encoders' features too, beside the LSTM's output."""


class MixtureConfig(Config, frozen=True):
    """Gaussian mixture over normalised actions."""

    modes: Positive = 5
    std_floor: Annotated[float, Gt(0), Lt(1)] = 0.01


class SmoothForm(Config, frozen=True):
    """Invariants without any division by a vanishing quantity."""

    form: Literal["smooth"] = "smooth"
    epsilon_m: Small = 1e-3
    """Below this length a step fades out of the directions."""
    epsilon_rad: Small = 5e-3
    epsilon_sine: Small = 1e-3


class PaperForm(Config, frozen=True):
    """Invariants as in the paper's appendix."""

    form: Literal["paper"] = "paper"
    full: bool = True
    """Also the last lengths and the last bend, which the paper's index range leaves out."""


InvariantForm: TypeAlias = Annotated[SmoothForm | PaperForm, Field(discriminator="form")]


class InvariantLossConfig(Config, frozen=True):
    """Motion-invariant loss."""

    weight: Weight = 1.0
    history_steps: Positive = 2
    """T of the loss: demonstrated actions before the predicted one, whatever the network sees."""
    form: InvariantForm = SmoothForm()

    @model_validator(mode="after")
    def _form_has_values(self) -> Self:
        if isinstance(self.form, PaperForm) and self.history_steps < 2:
            raise ValueError("history_steps: the paper's invariants need at least 2")
        return self


class GraspLossConfig(Config, frozen=True):
    """Binary cross-entropy on logits, heavier around transitions."""

    weight: Weight = 1.0
    transition_weight: Annotated[float, Ge(1)] = 3.0
    transition_steps: Annotated[int, Ge(0)] = 3
    """Frames on either side of a transition; 0.3 s at 10 Hz."""


class FutureLossConfig(Config, frozen=True):
    """Where the hand will be, said from the images of one moment alone.

    Any demonstration tells it. It teaches the encoders where things are long before the mixture
    does, whose gradient reaches them through everything else.
    """

    weight: Weight = 1.0
    horizons: Annotated[tuple[Positive, ...], Len(1, 8)] = (3, 8, 20)
    """Steps ahead."""


class LossConfig(Config, frozen=True):
    """Weights of the terms; a term that a method does not have is None."""

    nll: Weight = 1.0
    grasp: GraspLossConfig | None = None
    invariant: InvariantLossConfig | None = None
    future: FutureLossConfig | None = None


class LegatoLossConfig(LossConfig, frozen=True):
    """All three terms."""

    grasp: GraspLossConfig = GraspLossConfig()
    invariant: InvariantLossConfig = InvariantLossConfig()


class LegatoSe3LossConfig(LossConfig, frozen=True):
    """No invariants."""

    grasp: GraspLossConfig = GraspLossConfig()
    invariant: None = None


class BcRnnLossConfig(LossConfig, frozen=True):
    """The grasp is part of the mixture; invariants are optional."""

    grasp: None = None
    invariant: InvariantLossConfig | None = None


class NetworkConfig(Config, frozen=True):
    """What all methods share."""

    encoder: EncoderConfig = EncoderConfig()
    history: HistoryConfig = HistoryConfig()
    lstm: LstmConfig = LstmConfig()
    mlp: MlpConfig = MlpConfig()
    mixture: MixtureConfig = MixtureConfig()
    window: Annotated[int, Ge(1), Le(1000)] = 20
    """Steps of a training sequence; at run time the recurrent state is reset as often."""
    head: Literal["separate-grasp", "grasp-in-mixture"]
    loss: LossConfig


class LegatoConfig(NetworkConfig, frozen=True):
    """The method: 6-D mixture, grasp logit, invariants."""

    method: Literal["legato"] = "legato"
    head: Literal["separate-grasp"] = "separate-grasp"
    loss: LegatoLossConfig = LegatoLossConfig()


class LegatoSe3Config(NetworkConfig, frozen=True):
    """6-D mixture and grasp logit."""

    method: Literal["legato-se3"] = "legato-se3"
    head: Literal["separate-grasp"] = "separate-grasp"
    loss: LegatoSe3LossConfig = LegatoSe3LossConfig()


class BcRnnConfig(NetworkConfig, frozen=True):
    """7-D mixture with the grasp as its last dimension."""

    method: Literal["bc-rnn"] = "bc-rnn"
    head: Literal["grasp-in-mixture"] = "grasp-in-mixture"
    mixture: MixtureConfig = MixtureConfig(std_floor=1e-4)
    loss: BcRnnLossConfig = BcRnnLossConfig()


PolicyConfig: TypeAlias = Annotated[
    LegatoConfig | LegatoSe3Config | BcRnnConfig, Field(discriminator="method")
]
"""For validation from JSON: `TypeAdapter(PolicyConfig)`."""
