"""What policy services were told to load, so that one that starts again is told again."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from common.messages import CheckpointDescription, Header, PolicyLoad, PolicyLoaded

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Loaded:
    """A checkpoint that a service has loaded."""

    folder: str
    checkpoint: CheckpointDescription


class Reloads:
    """Loads by node, as long as the control plane runs.

    A service that starts again gets them one by one. Each is tried once per start: one that fails,
    or takes the service with it, is dropped, so that it cannot keep a service from starting.
    """

    def __init__(self) -> None:
        self._numbers = itertools.count()
        self._asked: dict[str, PolicyLoad] = {}
        self._again: set[str] = set()
        self._loaded: dict[str, dict[str, _Loaded]] = {}
        self._due: dict[str, dict[str, _Loaded]] = {}

    def begin(self, load: PolicyLoad) -> None:
        """A service is told to load."""
        self._asked[load.request] = load

    def end(self, answer: PolicyLoaded) -> None:
        """It has answered; what it loaded is remembered."""
        load = self._asked.pop(answer.request, None)
        if load is None:
            return
        if answer.checkpoint is not None:
            held = self._loaded.setdefault(load.node, {})
            held[load.policy] = _Loaded(load.folder, answer.checkpoint)
        elif answer.problem is not None:
            self._warn(load, answer.problem.happened)
        self._again.discard(load.request)

    def lose(self, requests: Iterable[str]) -> None:
        """A service is gone and will not answer these."""
        for request in requests:
            load = self._asked.pop(request, None)
            if load is not None:
                self._warn(load, "the service ended")
            self._again.discard(request)

    def restart(self, node: str) -> None:
        """A service has started: what it had loaded before is due."""
        due = {**self._due.pop(node, {}), **self._loaded.pop(node, {})}
        if due:
            self._due[node] = due

    def take(self, node: str, serves: Mapping[str, CheckpointDescription]) -> PolicyLoad | None:
        """The next load that is due, if any.

        Args:
            node: The service, which has just said what it is or carried out a load.
            serves: Its checkpoints. One that it still has needs no load: its link was lost and it
                was not.
        """
        due = self._due.get(node, {})
        while due:
            policy = next(iter(due))
            before = due.pop(policy)
            if serves.get(policy) == before.checkpoint:
                self._loaded.setdefault(node, {})[policy] = before
                continue
            request = f"again-{next(self._numbers)}"
            self._again.add(request)
            return PolicyLoad(
                header=Header(), request=request, node=node, policy=policy, folder=before.folder
            )
        return None

    def _warn(self, load: PolicyLoad, reason: str) -> None:
        """Whoever asked is told; nobody asked for a load that repeats one."""
        if load.request in self._again:
            fields = {"node": load.node, "policy": load.policy, "reason": reason}
            log.warning("policy lost at a restart", extra=fields)
