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
_NOMINAL_SHARE = 0.5
"""Share of the trials that leave a variation out: drawn evenly, nearly no trial would be nominal,
and a policy would know the hand that obeys at once from the rim of what it has seen."""


class Variation(BaseModel):
    """Largest values; a trial draws its own by its seed, evenly from zero to these.

    Each of the three is left out of half of the trials, whatever the others do.
    """

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
        lags, is_late, is_randomised = (random.random(size=3) >= _NOMINAL_SHARE).tolist()
        ticks = is_late * round(latency_share * self.action_latency_s / TICK_S)
        return request.model_copy(
            update={
                "tracking_lag_s": lags * lag_share * self.tracking_lag_s,
                "action_latency_s": ticks * TICK_S,
                "randomise_camera": is_randomised and self.randomise_camera,
            }
        )


NOMINAL = Variation()
"""Every trial as it is."""
