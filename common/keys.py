"""API keys of REST: what a role may do, and the file that keeps hashes and never a key.

A key is 32 random bytes. Nothing of 256 bits is guessed, so a plain SHA-256 protects it as well as
a slow hash would; those are for passwords, which people choose.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Callable
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, StringConstraints, ValidationError, model_validator

from common.errors import BadKeyFile, InvalidValue, UnknownName
from common.files import lock_folder, replace_file
from common.messages.base import Name

_CONFIG = ConfigDict(extra="forbid", frozen=True)
_PREFIX = "legato_"
"""Lets people and scanners of leaked secrets see what it is."""
_KEY_BYTES = 32


class Role(StrEnum):
    """What a key may do; each role includes those before it."""

    VIEW = "view"
    """Read."""
    OPERATE = "operate"
    """Start and stop what moves."""
    ADMIN = "admin"
    """Change what runs."""

    def includes(self, needed: Role) -> bool:
        """Whether a key of this role may do what another role is enough for."""
        order = list(Role)
        return order.index(self) >= order.index(needed)


class ApiKey(BaseModel):
    """Who may do what, without the key itself."""

    model_config = _CONFIG

    name: Name
    role: Role
    sha256: Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]
    """Of the key's UTF-8 text, in hexadecimal."""
    created: datetime


class KeyFile(BaseModel):
    """What a file of keys says."""

    model_config = _CONFIG

    version: Literal[1] = 1
    keys: tuple[ApiKey, ...] = ()

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        if len({key.name for key in self.keys}) < len(self.keys):
            raise ValueError("two keys have one name")
        return self

    def find(self, key: str) -> ApiKey | None:
        """The entry of a key.

        Every hash is compared, each in constant time: how long it takes says nothing.
        """
        given = hash_key(key)
        found = None
        for entry in self.keys:
            if hmac.compare_digest(entry.sha256, given):
                found = entry
        return found


def hash_key(key: str) -> str:
    """SHA-256 of a key in hexadecimal."""
    return hashlib.sha256(key.encode()).hexdigest()


def read_keys(path: Path) -> KeyFile:
    """Read a file of keys.

    Raises:
        BadKeyFile: There is none, or it is not one.
    """
    try:
        return KeyFile.model_validate_json(path.read_bytes())
    except OSError as error:
        raise BadKeyFile(str(path), error.strerror or str(error)) from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise BadKeyFile(str(path), f"{where}: {first['msg']}") from error


def create_key(path: Path, *, name: str, role: Role) -> str:
    """Make a key, add its hash to a file, which is made if need be, and return the key.

    Raises:
        BadKeyFile: The file is not one of keys, or cannot be written.
        InvalidValue: It has a key of that name.
    """
    key = _PREFIX + secrets.token_urlsafe(_KEY_BYTES)
    entry = ApiKey(
        name=name,
        role=role,
        sha256=hash_key(key),
        created=datetime.now(UTC).replace(microsecond=0),
    )

    def add(file: KeyFile) -> KeyFile:
        if any(each.name == name for each in file.keys):
            raise InvalidValue("name", name, f"a name that {path} does not have yet")
        return KeyFile(keys=(*file.keys, entry))

    _change(path, add, may_make=True)
    return key


def revoke_key(path: Path, *, name: str) -> None:
    """Remove a key from a file.

    Raises:
        BadKeyFile: There is no such file, it is not one of keys, or cannot be written.
        UnknownName: It has no such key.
    """

    def remove(file: KeyFile) -> KeyFile:
        names = [each.name for each in file.keys]
        if name not in names:
            raise UnknownName("key", name, names)
        return KeyFile(keys=tuple(each for each in file.keys if each.name != name))

    _change(path, remove, may_make=False)


def _change(path: Path, change: Callable[[KeyFile], KeyFile], *, may_make: bool) -> None:
    """Replace a file in one step; who changes it at the same time waits."""
    try:
        with lock_folder(path.parent):
            exists = path.exists()
            after = change(read_keys(path) if exists or not may_make else KeyFile())
            text = after.model_dump_json(indent=2) + "\n"
            replace_file(path, text, mode=path.stat().st_mode & 0o777 if exists else 0o644)
    except OSError as error:
        raise BadKeyFile(str(path), error.strerror or str(error)) from error
