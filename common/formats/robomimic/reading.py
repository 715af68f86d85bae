"""A file of robomimic as a data set."""

from __future__ import annotations

from pathlib import Path

from common.datasets import EpisodeWriter
from common.formats.outputs import new_output
from common.formats.robomimic.foreign import ForeignFile
from common.formats.robomimic.layout import SPEC_ATTRIBUTE
from common.formats.robomimic.options import ImportOptions
from common.formats.robomimic.own import OwnFile
from common.formats.robomimic.source import list_demos, open_file
from common.formats.summary import Advance, Summary, be_quiet


def import_robomimic(
    path: Path,
    folder: Path,
    options: ImportOptions | None = None,
    *,
    advance: Advance = be_quiet,
) -> Summary:
    """Make a data set of a file; of one that LEGATO exported, the same as before.

    Args:
        path: The HDF5 file.
        folder: Of the data set; it must not exist.
        options: What the file does not say; needed for files that LEGATO did not write.
        advance: Told after each episode.

    Raises:
        BadForeignFile: The file is damaged, or is not what it is said to be.
        InvalidValue: The folder exists, or an option is missing or contradicts the file.
        UnknownName: There is no such task, robot or camera.
        MissingExtra: h5py is not installed.
        NotWritable: The folder cannot be written.
        DiskFull: There is no room.
    """
    chosen = ImportOptions() if options is None else options
    with open_file(path) as file, new_output(folder) as made:
        demos = list_demos(path, file)
        if SPEC_ATTRIBUTE in file["data"].attrs:
            source = OwnFile(str(path), file["data"], chosen)
        else:
            source = ForeignFile(str(path), demos, chosen)
        with EpisodeWriter.open(made, source.spec) as writer:
            for number, demo in enumerate(demos, 1):
                writer.append(*source.convert(demo))
                advance(number, len(demos))
            rows = writer.rows
    return Summary(folder, len(demos), rows, source.notes)
