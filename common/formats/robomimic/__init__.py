"""robomimic's HDF5 files, both ways."""

from __future__ import annotations

from common.formats.robomimic.options import ImportOptions
from common.formats.robomimic.reading import import_robomimic
from common.formats.robomimic.writing import export_robomimic

__all__ = ["ImportOptions", "export_robomimic", "import_robomimic"]
