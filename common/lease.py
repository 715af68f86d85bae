"""How long a silent link is believed to be alive."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Le

SHORTEST_LEASE_S = 0.5
LONGEST_LEASE_S = 60.0

LeaseS = Annotated[float, Ge(SHORTEST_LEASE_S), Le(LONGEST_LEASE_S)]
"""Too short, and work cannot be told from silence; too long, and nobody waits for it."""

LOCAL_LEASE_S = 1.0
ENCRYPTED_LEASE_S = 2.0
"""An encrypted link is one between hosts."""

TICK_LEASES = 1.6
"""A tick waits longer for an answer than a lease: a node that hangs is named as lost."""
