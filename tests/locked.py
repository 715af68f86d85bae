"""What a lock or constraints file of the project says."""

from __future__ import annotations

import re

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def read_entries(text: str) -> dict[str, tuple[Requirement, list[str]]]:
    """Requirement and hashes by name; a line that goes on ends in a backslash."""
    entries = {}
    for line in text.replace("\\\n", " ").splitlines():
        if line.strip() and not line.startswith("#"):
            pinned, *hashes = re.split(r"\s+--hash=", line.strip())
            requirement = Requirement(pinned)
            entries[canonicalize_name(requirement.name)] = (requirement, hashes)
    return entries


def version_of(requirement: Requirement) -> str:
    """The one version that a requirement allows."""
    (pin,) = requirement.specifier
    assert pin.operator == "==", requirement
    return pin.version
