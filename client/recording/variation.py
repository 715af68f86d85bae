"""How the trials of a recording differ from the nominal one, so that policies meet real robots."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Ge, Le
from pydantic import BaseModel, ConfigDict

from common.api import EvaluationRequest
from common.clock import TICK_S

_STREAM = 3
"""Worlds, experts and sensors draw from other streams of a trial's seed."""


class Variation(BaseModel):
    """Largest values; each trial draws its own, evenly from zero to these, by its seed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    tracking_lag_s: Annotated[float, Ge(0), Le(1)] = 0.0
    action_latency_s: Annotated[float, Ge(0), Le(1)] = 0.0
    """Drawn in whole ticks of 10 ms."""
    randomise_camera: bool = False

    def apply(self, request: EvaluationRequest, *, seed: int) -> EvaluationRequest:
        """The request of one trial.

        Args:
            request: The nominal one.
            seed: Of the trial.
        """
        random = np.random.default_rng([seed, _STREAM])
        lag_share, latency_share = random.uniform(size=2).tolist()
        ticks = round(latency_share * self.action_latency_s / TICK_S)
        return request.model_copy(
            update={
                "tracking_lag_s": lag_share * self.tracking_lag_s,
                "action_latency_s": ticks * TICK_S,
                "randomise_camera": self.randomise_camera,
            }
        )


NOMINAL = Variation()
"""Every trial as it is."""
