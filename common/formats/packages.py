"""The packages of the extra `formats`, loaded where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from common.errors import MissingExtra


def load_package(name: str) -> Any:
    """Import a package of the extra `formats`.

    Args:
        name: Of the module, e.g. `h5py` or `pyarrow.parquet`.

    Raises:
        MissingExtra: It is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise MissingExtra(error.name or name, "formats") from error
