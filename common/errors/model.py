"""A robot, task or calibration file that cannot be used."""

from __future__ import annotations

from collections.abc import Sequence

from common.errors.base import LegatoError


class ModelError(LegatoError):
    """A robot, task or calibration file that cannot be used."""

    code = "E-MODEL"


class BadRobotFile(ModelError):
    """A robot folder with a missing, unreadable or contradictory entry."""

    code = "E-ROBOT-FILE"

    def __init__(self, robot: str, element: str, problem: str) -> None:
        self.robot = robot
        self.element = element
        self.problem = problem
        super().__init__(
            f"robot {robot}: {element}: {problem}",
            expected="expected model.xml and robot.toml to agree",
            action=f"correct the files in the folder {robot}",
        )


class ModelMismatch(ModelError):
    """The Pinocchio model and the MuJoCo model of one robot disagree."""

    code = "E-MODEL-MISMATCH"

    def __init__(self, robot: str, what: str, difference: float, tolerance: float) -> None:
        self.robot = robot
        self.what = what
        self.difference = difference
        self.tolerance = tolerance
        super().__init__(
            f"robot {robot}: {what} differs by {difference:.3g} between MuJoCo and Pinocchio",
            expected=f"expected at most {tolerance:.1g}",
            action=f"check the joints in model.xml of {robot}",
        )


class BadCalibration(ModelError):
    """A camera calibration file that cannot be used."""

    code = "E-CALIBRATION"

    def __init__(self, name: str, problem: str) -> None:
        self.name = name
        self.problem = problem
        super().__init__(
            f"camera {name}: {problem}",
            expected="expected a calibration as described in docs/conventions.md",
            action=f"correct common/calibration/{name}.toml",
        )


class FootholdOutOfReach(ModelError):
    """A body pose in which a leg cannot keep its foot where it stands."""

    code = "E-FOOTHOLD"

    def __init__(self, leg: str, p_hip_foot_m: Sequence[float], problem: str) -> None:
        self.leg = leg
        self.p_hip_foot_m = tuple(p_hip_foot_m)
        self.problem = problem
        x, y, z = self.p_hip_foot_m
        super().__init__(
            f"leg {leg} cannot reach its foothold at ({x:.3f}, {y:.3f}, {z:.3f}) m from the hip",
            expected=problem,
            action="narrow the body's joint ranges in model.xml",
        )


class UnsupportedGeom(ModelError):
    """A visible geom of a kind that the ray camera cannot draw."""

    code = "E-GEOM"

    def __init__(self, geom: str, body: str, kind: str, known: Sequence[str]) -> None:
        self.geom = geom
        self.body = body
        self.kind = kind
        self.known = tuple(known)
        super().__init__(
            f"geom {geom} of body {body} is a {kind}, which the camera cannot draw",
            expected=f"expected one of: {', '.join(self.known)}",
            action="draw it with those shapes, or hide it from cameras with group 4 or 5",
        )


class BadMeshes(ModelError):
    """A folder of meshes that cannot be used, or a robot that has none."""

    code = "E-MESHES"

    def __init__(self, robot: str, problem: str, *, expected: str) -> None:
        self.robot = robot
        self.problem = problem
        super().__init__(
            f"meshes of {robot}: {problem}",
            expected=f"expected {expected}",
            action="give another folder, or draw the robot without meshes (docs/camera.md)",
        )


class MeshesDoNotFit(ModelError):
    """A model with meshes whose bodies do not move as ours do."""

    code = "E-MESHES-FIT"

    def __init__(
        self, robot: str, body: str, *, apart: tuple[float, float], most: tuple[float, float]
    ) -> None:
        self.robot = robot
        self.body = body
        self.apart_m, self.apart_rad = apart
        super().__init__(
            f"meshes of {robot}: body {body} is {1e3 * self.apart_m:.1f} mm and "
            f"{self.apart_rad:.3f} rad away from where model.xml has it",
            expected=f"expected at most {1e3 * most[0]:g} mm and {most[1]:g} rad in every posture",
            action=f"correct the table [meshes] in robot.toml of {robot}, or give another folder",
        )
