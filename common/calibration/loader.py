"""Find and read the calibrations that ship with LEGATO."""

from __future__ import annotations

import tomllib
from pathlib import Path

from pydantic import ValidationError

from common.calibration.stereo import StereoCalibration
from common.errors import BadCalibration, UnknownName

CALIBRATION_FOLDER = Path(__file__).parent


def list_calibrations(*, folder: Path = CALIBRATION_FOLDER) -> list[str]:
    """Names of all calibrations: the TOML files of the folder."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def load_calibration(name: str, *, folder: Path = CALIBRATION_FOLDER) -> StereoCalibration:
    """Read one calibration.

    Args:
        name: File name without `.toml`, e.g. `t265`.
        folder: Where the files are.

    Raises:
        UnknownName: No such calibration.
        BadCalibration: The file is not TOML, or has a missing, wrong or unknown entry.
    """
    known = list_calibrations(folder=folder)
    if name not in known:
        raise UnknownName("camera", name, known)
    try:
        fields = tomllib.loads((folder / f"{name}.toml").read_text())
    except tomllib.TOMLDecodeError as error:
        raise BadCalibration(name, str(error)) from error
    try:
        return StereoCalibration.model_validate({**fields, "name": name})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadCalibration(name, f"{where}: {first['msg']}" if where else first["msg"]) from error
