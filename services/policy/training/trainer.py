"""One update of the network, and its losses on held-out windows: the same code everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.parallel import DistributedDataParallel

from services.policy.learning.losses import LossTerms, compute_loss
from services.policy.learning.network import PolicyNetwork, PolicyOutput
from services.policy.learning.normalization import ActionStatistics
from services.policy.training.config import TrainingConfig
from services.policy.training.device import Placement
from services.policy.training.schedule import learning_rate
from services.policy.training.windows import WindowBatch, WindowLoader

_METRES = slice(0, 3)
_RADIANS = slice(3, 6)
_TERMS = ("total", "nll", "grasp", "invariant", "future")


@dataclass(frozen=True)
class UpdateReport:
    """What one update says of itself; means over its batch."""

    loss: float
    nll: float
    grasp: float | None
    invariant: float | None
    future: float | None
    gradient_norm: float
    learning_rate: float


@dataclass(frozen=True)
class PretrainingReport:
    """What one update of the encoders says of itself."""

    future: float


@dataclass(frozen=True)
class ValidationReport:
    """Means over all held-out windows; errors of the most likely action."""

    loss: float
    nll: float
    grasp: float | None
    invariant: float | None
    error_m: float
    error_rad: float
    grasp_accuracy: float


class Trainer:
    """Network, optimiser and the place where both live.

    Args:
        config: Of the run.
        statistics: Of the actions that are trained on.
        placement: Device and rank.
    """

    def __init__(
        self, config: TrainingConfig, statistics: ActionStatistics, placement: Placement
    ) -> None:
        torch.manual_seed(config.seed)
        self.config, self.statistics = config, statistics
        self.placement = placement
        self.network = PolicyNetwork(config.network).to(placement.device)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(),
            lr=config.optimiser.learning_rate,
            weight_decay=config.optimiser.weight_decay,
        )
        self._model: nn.Module = self.network
        if placement.world_size > 1:
            self._model = DistributedDataParallel(self.network)
        self._scale = torch.tensor(statistics.scale, device=placement.device)

    def pretrain(self, batch: WindowBatch, update: int) -> PretrainingReport:
        """One step of the encoders alone, by where the hand will be.

        Args:
            batch: This process's share, of windows of one frame.
            update: Number of the update, from 0.
        """
        pretraining = self.config.pretraining
        if pretraining is None:
            raise RuntimeError("the config has no pretraining")
        self._set_rate(update, pretraining.learning_rate, pretraining.updates)
        self.network.train()
        self.optimiser.zero_grad(set_to_none=True)
        placed = batch.to(self.placement.device)
        with self._precision():
            said = self.network.foresee(self.network.encode(placed.images.flatten(0, 1)))
        demonstrated = placed.targets.future
        if said is None or demonstrated is None:
            raise RuntimeError("the network has no loss of the future")
        loss = functional.smooth_l1_loss(said, demonstrated.flatten(0, 1))
        loss.backward()
        if self.placement.world_size > 1:
            # Outside the wrapper, which would miss the parameters that this loss does not reach.
            for parameter in self.network.parameters():
                if parameter.grad is not None:
                    dist.all_reduce(parameter.grad)
                    parameter.grad /= self.placement.world_size
        self.optimiser.step()
        (future,) = self.placement.mean([loss.item()])
        return PretrainingReport(future=future)

    def update(self, batch: WindowBatch, update: int) -> UpdateReport:
        """One step of the optimiser.

        Args:
            batch: This process's share.
            update: Number of the update, from 0.

        Raises:
            FloatingPointError: The gradient is not finite; the network is as before.
        """
        optimiser = self.config.optimiser
        rate = self._set_rate(update, optimiser.learning_rate, self.config.updates)
        self._seed_draws(update)
        self.network.train()
        self.optimiser.zero_grad(set_to_none=True)
        terms = self._losses(batch.to(self.placement.device))
        terms.total.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), optimiser.clip_norm)
        gradient_norm = float(norm)
        if not math.isfinite(gradient_norm):
            raise FloatingPointError(f"the gradient of update {update} is not finite")
        self.optimiser.step()
        return UpdateReport(
            **self._list_losses(terms),  # pyright: ignore[reportArgumentType]
            gradient_norm=gradient_norm,
            learning_rate=rate,
        )

    @torch.no_grad()
    def validate(self, loader: WindowLoader) -> ValidationReport:
        """Losses and errors on the held-out windows."""
        self.network.eval()
        sums: dict[str, float] = {}
        windows = 0
        for batch in loader.validation():
            placed = batch.to(self.placement.device)
            output = self._run(self.network, placed)
            terms = self._terms(output, placed)
            values = {
                "loss": float(terms.total),
                "nll": float(terms.nll),
                "grasp": _number(terms.grasp),
                "invariant": _number(terms.invariant),
                **self._errors(output, placed),
            }
            count = len(placed.images)
            windows += count
            for name, value in values.items():
                if value is not None:
                    sums[name] = sums.get(name, 0.0) + count * value
        means = {name: value / windows for name, value in sums.items()}
        return ValidationReport(
            **{"grasp": None, "invariant": None, **means}  # pyright: ignore[reportArgumentType]
        )

    def _set_rate(self, update: int, peak: float, updates: int) -> float:
        warmup = self.config.optimiser.warmup_steps
        rate = learning_rate(update, peak=peak, warmup=min(warmup, updates // 10), updates=updates)
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        return rate

    def _seed_draws(self, update: int) -> None:
        """What a network draws (hidden histories) depends on seed, update and process only."""
        seed = np.random.SeedSequence([self.config.seed, update, self.placement.rank])
        torch.manual_seed(int(seed.generate_state(1)[0]))

    def _list_losses(self, terms: LossTerms) -> dict[str, float | None]:
        """Terms by name, over all processes; None where the method has none."""
        named = ((name, getattr(terms, name)) for name in _TERMS)
        known = {name: float(term.detach()) for name, term in named if term is not None}
        means = dict(zip(known, self.placement.mean(list(known.values())), strict=True))
        return {"loss": means["total"], **{name: means.get(name) for name in _TERMS[1:]}}

    def _precision(self) -> torch.autocast:
        lower = self.config.precision == "bf16"
        return torch.autocast(self.placement.device.type, dtype=torch.bfloat16, enabled=lower)

    def _losses(self, batch: WindowBatch) -> LossTerms:
        return self._terms(self._run(self._model, batch), batch)

    def _run(self, model: nn.Module, batch: WindowBatch) -> PolicyOutput:
        """Forward pass in the run's precision; outputs are float32."""
        with self._precision():
            output, _ = model(batch.images, batch.history / self._scale)
        return output

    def _terms(self, output: PolicyOutput, batch: WindowBatch) -> LossTerms:
        return compute_loss(
            output, batch.targets, config=self.config.network, statistics=self.statistics
        )

    def _errors(self, output: PolicyOutput, batch: WindowBatch) -> dict[str, float]:
        """Of the action that deployment would take."""
        likely = output.mixture.most_likely_mean()
        error = likely[..., :6] * self._scale - batch.targets.actions
        closed = likely[..., 6] > 0.0 if output.grasp_logit is None else output.grasp_logit > 0.0
        return {
            "error_m": float(error[..., _METRES].norm(dim=-1).mean()),
            "error_rad": float(error[..., _RADIANS].norm(dim=-1).mean()),
            "grasp_accuracy": float((closed == (batch.targets.grasp > 0.5)).float().mean()),
        }


def _number(term: Tensor | None) -> float | None:
    return None if term is None else float(term.detach())
