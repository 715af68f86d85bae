"""The first line of a shard's file: which evaluation it belongs to, and what it was run by."""

from __future__ import annotations

import hashlib
import json
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from annotated_types import Ge, Len
from pydantic import BaseModel, ConfigDict, model_validator

from client.sharding.code import hash_code
from client.sharding.shard import Shard
from common.api import EvaluationRequest

if TYPE_CHECKING:
    from services.policy.serving.library import Library

FORMAT = "legato-shard"
VERSION = 1

_CONFIG = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Origin(BaseModel):
    """Everything that decides what comes out of a trial.

    Equal origins give equal evaluations; `digest` names one.
    """

    model_config = _CONFIG

    request: EvaluationRequest
    versions: dict[str, str]
    """Of the code, of the packages that shape results, and of the learned policies."""
    code_sha256: Annotated[str, Len(64, 64)]

    @property
    def digest(self) -> str:
        """SHA-256 over all of it."""
        fields = self.model_dump(mode="json")
        return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()

    def first_difference(self, other: Origin) -> tuple[str, str, str] | None:
        """What differs, here and there; None if nothing does."""
        mine, theirs = _flatten(self), _flatten(other)
        for name in dict.fromkeys([*mine, *theirs]):
            here, there = mine.get(name, "nothing"), theirs.get(name, "nothing")
            if here != there:
                return name, here, there
        return None


class ShardHeader(BaseModel):
    """The first line of a shard's file."""

    model_config = _CONFIG

    format: Literal["legato-shard"] = FORMAT
    version: Literal[1] = VERSION
    number: Annotated[int, Ge(0)]
    count: Annotated[int, Ge(1)]
    digest: Annotated[str, Len(64, 64)]
    """Of `origin`."""
    origin: Origin
    created_at: datetime

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if self.number >= self.count:
            raise ValueError(f"number {self.number} of {self.count} shards")
        if self.digest != self.origin.digest:
            raise ValueError("the digest is not that of the origin")
        return self

    @property
    def shard(self) -> Shard:
        """Which one it is."""
        return Shard(self.number, self.count)

    @property
    def evaluation(self) -> str:
        """Id of the evaluation, the same in every shard."""
        return f"e-{self.digest[:8]}"


def describe_origin(request: EvaluationRequest, library: Library) -> Origin:
    """What decides the results of a request in this installation.

    Args:
        request: The grid.
        library: The learned policies that it names.

    Raises:
        ModuleNotFoundError: A package of a service is not installed.
    """
    # Here, because it imports the services.
    from client.offline import list_software

    versions: dict[str, str] = {}
    software, learned = list_software(), library.describe()
    # In the order in which an evaluation meets them: that is how its record lists them.
    for policy in request.policy_names:
        acting = {f"policy {policy}": learned[policy].sha256} if policy in learned else {}
        versions |= dict(sorted((software | acting).items()))
    return Origin(request=request, versions=versions, code_sha256=hash_code())


def _flatten(origin: Origin) -> dict[str, str]:
    """Names of everything that may differ, and what it is."""
    request: dict[str, Any] = origin.request.model_dump(mode="json")
    versions = {f"version of {name}": version for name, version in origin.versions.items()}
    asked = {name: json.dumps(value) for name, value in request.items()}
    return {**asked, **versions, "code": origin.code_sha256[:12]}
