"""The API key that the environment gives to whoever speaks REST."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from common.errors import InvalidValue

KEY = "LEGATO_API_KEY"
FILE = "LEGATO_API_KEY_FILE"


def find_api_key(environment: Mapping[str, str]) -> str | None:
    """The key, or None where there is none; an empty variable is one that is not set.

    Raises:
        InvalidValue: Both variables are set, the file cannot be read, or that is no key.
    """
    key, file = environment.get(KEY), environment.get(FILE)
    if key and file:
        raise InvalidValue(f"{KEY} and {FILE}", "both set", "one of them")
    if key:
        return _check(KEY, key)
    if not file:
        return None
    try:
        text = Path(file).read_text()
    except (OSError, UnicodeDecodeError) as error:
        problem = error.strerror if isinstance(error, OSError) else "not text"
        raise InvalidValue(FILE, file, f"a file with the key ({problem})") from error
    return _check(FILE, text.strip())


def _check(variable: str, key: str) -> str:
    # What is wrong with it is not shown: it may be a key with a typing error.
    if not (key and key.isascii() and key.isprintable() and " " not in key):
        raise InvalidValue(variable, "…", "a key, as `legato keys create` printed it")
    return key
