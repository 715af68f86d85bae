"""The policy network: stereo images and previous actions to a mixture and a grasp.

z_t = [enc_left(I_left), enc_right(I_right), a_{t-T}, ..., a_{t-1}]
y_t, (h, c)_t = LSTM(z_t, (h, c)_{t-1});  f_t = MLP(y_t);  mixture(f_t), grasp logit(f_t)
where the compact sizes give the MLP [y_t, enc_left, enc_right]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import torch
from torch import Tensor, nn

from common.errors import InvalidValue
from services.policy.learning.config import NetworkConfig
from services.policy.learning.encoder import Encoder
from services.policy.learning.gmm import Mixture, MixtureHead

POSE_DIMS = 6
EYES = 2

RecurrentState: TypeAlias = tuple[Tensor, Tensor]
"""h and c of the LSTM, each (layers, B, width)."""


@dataclass(frozen=True)
class PolicyOutput:
    """What the network says about each step.

    Args:
        mixture: Over the normalised action: 6 numbers, or 7 with the grasp as the last.
        grasp_logit: (...) log-odds of a closed gripper; None where the mixture has the grasp.
        future: (..., horizons, 6) where the hand will be, in units of its spread; in training only.
    """

    mixture: Mixture
    grasp_logit: Tensor | None
    future: Tensor | None = None


class PolicyNetwork(nn.Module):
    """Network of one method.

    Args:
        config: Sizes and head.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.left = Encoder(config.encoder)
        self.right = Encoder(config.encoder)
        inputs = EYES * config.encoder.features + POSE_DIMS * config.history.steps
        self.lstm = nn.LSTM(inputs, config.lstm.width, config.lstm.layers, batch_first=True)
        layers: list[nn.Module] = []
        seen = EYES * config.encoder.features if config.mlp.sees_images else 0
        width = config.lstm.width + seen
        for _ in range(config.mlp.layers):
            layers.append(nn.Linear(width, config.mlp.width))
            if config.mlp.layer_norm:
                layers.append(nn.LayerNorm(config.mlp.width))
            layers.append(nn.ReLU())
            width = config.mlp.width
        self.mlp = nn.Sequential(*layers)
        separate = config.head == "separate-grasp"
        self.mixture = MixtureHead(
            inputs=width,
            modes=config.mixture.modes,
            dims=POSE_DIMS if separate else POSE_DIMS + 1,
            std_floor=config.mixture.std_floor,
        )
        self.grasp = nn.Linear(width, 1) if separate else None
        future = config.loss.future
        self.future = (
            None
            if future is None
            else nn.Linear(EYES * config.encoder.features, POSE_DIMS * len(future.horizons))
        )
        # Convolutions on CPU are faster with the channels innermost.
        nn.utils.convert_conv2d_weight_memory_format(self, torch.channels_last)

    def forward(
        self, images: Tensor, history: Tensor, state: RecurrentState | None = None
    ) -> tuple[PolicyOutput, RecurrentState]:
        """A window of steps.

        Args:
            images: (B, T, 2, px, px) uint8, left eye first.
            history: (B, T, history steps, 6) previous actions, normalised, oldest first.
            state: Of the LSTM before the window; None = zero.

        Returns:
            Outputs (B, T, ...) and the state after the window.

        Raises:
            InvalidValue: A shape or type that is not the config's.
        """
        self._check(images, history)
        batch, steps = images.shape[:2]
        seen = self.encode(images.flatten(0, 1))
        past = self._hide_history(history).flatten(2)
        now = seen.unflatten(0, (batch, steps))
        inputs = torch.cat([now, past.to(seen.dtype)], dim=-1)
        remembered, after = self.lstm(inputs, state)
        if self.config.mlp.sees_images:
            remembered = torch.cat([remembered, now.to(remembered.dtype)], dim=-1)
        features = self.mlp(remembered)
        logit = None if self.grasp is None else self.grasp(features).float().squeeze(-1)
        future = self.foresee(seen) if self.training else None
        if future is not None:
            future = future.unflatten(0, (batch, steps))
        return PolicyOutput(self.mixture(features), logit, future), after

    def encode(self, images: Tensor) -> Tensor:
        """(B, 2, px, px) uint8 -> (B, features of both eyes)."""
        scaled = images.float() / 255.0
        return torch.cat([self.left(scaled[:, :1]), self.right(scaled[:, 1:])], dim=-1)

    def foresee(self, seen: Tensor) -> Tensor | None:
        """(B, features of both eyes) -> (B, horizons, 6) where the hand will be, if it is asked."""
        if self.future is None:
            return None
        return self.future(seen).float().unflatten(-1, (-1, POSE_DIMS))

    def step(
        self, images: Tensor, history: Tensor, state: RecurrentState
    ) -> tuple[PolicyOutput, RecurrentState]:
        """One step of deployment: `forward` for (B, 2, px, px) and (B, history steps, 6)."""
        output, state = self(images[:, None], history[:, None], state)
        logit = None if output.grasp_logit is None else output.grasp_logit[:, 0]
        mixture = Mixture(
            output.mixture.log_weights[:, 0], output.mixture.means[:, 0], output.mixture.stds[:, 0]
        )
        return PolicyOutput(mixture, logit), state

    def initial_state(self, batch: int) -> RecurrentState:
        """Zero state for a number of cells, on the network's device."""
        weight = next(self.parameters())
        shape = (self.config.lstm.layers, batch, self.config.lstm.width)
        return weight.new_zeros(shape), weight.new_zeros(shape)

    def _hide_history(self, history: Tensor) -> Tensor:
        """In training, zero the history of some windows.

        Whole windows: what is hidden in one step only, the LSTM knows from the steps beside it.
        """
        if not self.training or self.config.history.dropout == 0.0:
            return history
        kept = torch.rand(len(history), 1, 1, 1, device=history.device)
        return torch.where(kept < self.config.history.dropout, 0.0, history)

    def _check(self, images: Tensor, history: Tensor) -> None:
        px = self.config.encoder.input_px
        if images.dtype != torch.uint8 or images.dim() != 5 or images.shape[2:] != (EYES, px, px):
            got = f"{images.dtype} of {list(images.shape)}"
            raise InvalidValue("images", got, f"torch.uint8 of [B, T, {EYES}, {px}, {px}]")
        expected = (*images.shape[:2], self.config.history.steps, POSE_DIMS)
        if tuple(history.shape) != expected:
            raise InvalidValue("history", list(history.shape), f"shape {list(expected)}")
