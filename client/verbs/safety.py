"""`legato stop` and `legato reset`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from client.api import LegatoClient
from client.commands import Reset, Stop
from client.tables import format_cells
from common.api import CellInfo


def stop(command: Stop) -> int:
    """Stop cells and show that they are."""
    with LegatoClient(command.url) as client:
        cells = client.stop(command.cell or None, reason=command.reason)
    _show(cells, as_json=command.json)
    return 0


def reset(command: Reset) -> int:
    """Release cells and show that they are."""
    with LegatoClient(command.url) as client:
        cells = client.reset(command.cell or None)
    _show(cells, as_json=command.json)
    return 0


def _show(cells: Sequence[CellInfo], *, as_json: bool) -> None:
    if as_json:
        shown = {"cells": [each.model_dump(mode="json") for each in cells]}
        sys.stdout.write(json.dumps(shown) + "\n")
    else:
        sys.stdout.write(format_cells(cells) + "\n")
