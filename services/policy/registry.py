"""Policies that come with the code, by name. Learned ones are in `serving/library.py`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from services.policy.control_arms import HoldPolicy, RandomPolicy
from services.policy.expert import ExpertPolicy
from services.policy.noisy_expert import NoisyExpertPolicy
from services.policy.policy import Policy

BUILT_IN: Mapping[str, Callable[[], Policy]] = {
    "expert": ExpertPolicy,
    "expert-noisy": NoisyExpertPolicy,
    "hold": HoldPolicy,
    "random": RandomPolicy,
}
