"""Camera calibrations: how a pixel looks into the world. `load_calibration` reads one by name."""

from __future__ import annotations

from common.calibration.loader import list_calibrations, load_calibration
from common.calibration.projection import KannalaBrandt, Pinhole
from common.calibration.stereo import R_TOOL_CAMERA, StereoCalibration

__all__ = [
    "KannalaBrandt",
    "Pinhole",
    "R_TOOL_CAMERA",
    "StereoCalibration",
    "list_calibrations",
    "load_calibration",
]
