"""`legato policy list` and `legato policy load`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from client.api import LegatoClient
from client.commands import PolicyList, PolicyLoad
from client.tables import format_table
from common.api import PolicyInfo
from common.errors import InvalidValue
from common.messages.base import Name


def show_all(command: PolicyList) -> int:
    """Show every policy with what is known of it."""
    with LegatoClient(command.url) as client:
        policies = client.policies()
    if command.json:
        shown = {"policies": [each.model_dump(mode="json") for each in policies]}
        sys.stdout.write(json.dumps(shown) + "\n")
    else:
        sys.stdout.write(format_policies(policies) + "\n")
    return 0


def load(command: PolicyLoad) -> int:
    """Let policy services load a checkpoint and show what they have then."""
    name, node = _name("NAME", command.name), command.node
    folder = Path(command.folder)
    # On one machine the service's working directory is not the shell's.
    where = str(folder.absolute()) if folder.is_dir() else command.folder
    with LegatoClient(command.url) as client:
        info = client.load_policy(name, where, node=None if node is None else _name("--node", node))
    if command.json:
        sys.stdout.write(json.dumps(info.model_dump(mode="json")) + "\n")
    else:
        sys.stdout.write(format_policies([info]) + "\n")
    return 0


def format_policies(policies: Sequence[PolicyInfo]) -> str:
    """One row per policy and node that serves it."""
    rows: list[tuple[str, ...]] = []
    for info in policies:
        for node in info.nodes:
            known = info.checkpoints.get(node)
            rows.append(
                (info.name, node, "-", "built in", "-", "-", "-")
                if known is None
                else (
                    *(info.name, node, ", ".join(known.tasks), known.method),
                    *(f"{known.runtime}, {known.device}", known.sha256[:12], known.folder),
                )
            )
    headers = ("policy", "node", "tasks", "method", "runs on", "hash", "folder")
    return format_table(headers, rows)


def _name(option: str, given: str) -> str:
    try:
        return TypeAdapter[str](Name).validate_python(given)
    except ValidationError as error:
        expected = "letters, digits and . _ @ -, at most 64"
        raise InvalidValue(option, given, expected) from error
