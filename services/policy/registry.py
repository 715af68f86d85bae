"""Policies by name. A policy is chosen per evaluation; the process stays up."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from common.errors import UnknownName
from services.policy.control_arms import HoldPolicy, RandomPolicy
from services.policy.expert import ExpertPolicy
from services.policy.policy import Policy

BUILT_IN: Mapping[str, Callable[[], Policy]] = {
    "expert": ExpertPolicy,
    "hold": HoldPolicy,
    "random": RandomPolicy,
}


def make_policy(name: str, known: Mapping[str, Callable[[], Policy]] = BUILT_IN) -> Policy:
    """A fresh policy for one cell.

    Raises:
        UnknownName: No such policy.
    """
    if name not in known:
        raise UnknownName("policy", name, sorted(known))
    return known[name]()
