"""The one tree of errors.

LegatoError
├─ ConfigError      UnknownName, InvalidValue, BadCertificate, MissingExtra, MissingProgram,
│                   UntrainedTask, BadKeyFile, BadGrants, NotRevocable, Exposed
├─ AccessError      KeyRefused, RoleTooLow, ForeignPage, TooManyCalls
├─ ContractError    SchemaMismatch, MalformedMessage, ForeignMessage, WrongShape
├─ ModelError       BadRobotFile, ModelMismatch, BadCalibration, FootholdOutOfReach,
│                   UnsupportedGeom, BadMeshes, MeshesDoNotFit
├─ LinkError        RouterUnreachable (and RouterRefused), NotReady, NodeTimeout, AlreadyRunning,
│                   PortInUse
├─ SafetyError      EmergencyStopped, StaleCommand
└─ StoreError       NotFound, NotWritable

Each class is built from data, has a stable code and says what happened, what was expected or
available, and what to do. Three edges translate it: the command line, REST (problem+json) and the
bus (`EpisodeReady.problem`). Nothing else catches broadly.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import ClassVar


class LegatoError(Exception):
    """Root of every error that LEGATO raises on purpose."""

    code: ClassVar[str] = "E-LEGATO"
    http_status: ClassVar[int] = 500

    def __init__(self, happened: str, *, expected: str, action: str) -> None:
        self.happened = happened
        self.expected = expected
        self.action = action
        super().__init__(f"{happened}; {expected}; {action}")

    def describe(self) -> dict[str, str]:
        """Give the parts of the error as data, for any edge."""
        return {
            "code": self.code,
            "happened": self.happened,
            "expected": self.expected,
            "action": self.action,
        }


class ConfigError(LegatoError):
    """What was asked for cannot be meant."""

    code = "E-CONFIG"
    http_status = 422


class UnknownName(ConfigError):
    """A task, robot, policy, camera or topic that does not exist."""

    code = "E-UNKNOWN-NAME"

    def __init__(self, kind: str, name: str, known: Sequence[str]) -> None:
        self.kind = kind
        self.name = name
        self.known = tuple(known)
        close = difflib.get_close_matches(name, self.known, n=1, cutoff=0.5)
        self.suggestion = close[0] if close else None
        super().__init__(
            f'no {kind} "{name}"',
            expected=f"known: {', '.join(self.known) or 'none'}",
            action=f"did you mean: {self.suggestion}" if self.suggestion else "use a known name",
        )


class InvalidValue(ConfigError):
    """A value outside what the field allows."""

    code = "E-INVALID-VALUE"

    def __init__(self, field: str, value: object, expected: str) -> None:
        self.field = field
        self.value = value
        super().__init__(
            f"{field} is {value!r}", expected=f"expected {expected}", action=f"change {field}"
        )


class BadCertificate(ConfigError):
    """A certificate or key that is missing, cannot be read, or is not valid."""

    code = "E-CERTIFICATE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"{path}: {problem}",
            expected="expected ca.pem, cert.pem and key.pem of one role, readable and valid now",
            action="copy the role's folder again, or make it with: legato certs (docs/security.md)",
        )


class MissingExtra(ConfigError):
    """A third-party package that an extra would have installed."""

    code = "E-MISSING-EXTRA"

    def __init__(self, package: str, extra: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(
            f"the package {package} is not installed",
            expected=f"it comes with the extra [{extra}]",
            action=f"run: pip install 'legato[{extra}]'",
        )


class MissingProgram(ConfigError):
    """A program of the machine that is needed and not there."""

    code = "E-MISSING-PROGRAM"

    def __init__(self, program: str, wanted: str) -> None:
        self.program = program
        super().__init__(
            f"there is no {program} on the PATH",
            expected=f"expected {wanted}",
            action=f"install it, or do without what needs {program}",
        )


class UntrainedTask(ConfigError):
    """A policy that was not trained for the task."""

    code = "E-UNTRAINED-TASK"

    def __init__(self, policy: str, task: str, tasks: Sequence[str]) -> None:
        self.policy = policy
        self.task = task
        self.tasks = tuple(tasks)
        super().__init__(
            f'the policy {policy} was not trained for the task "{task}"',
            expected=f"trained for: {', '.join(tasks)}",
            action="choose another policy or another task",
        )


class BadKeyFile(ConfigError):
    """A file of API keys that cannot be used."""

    code = "E-KEY-FILE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"keys in {path}: {problem}",
            expected="expected a file as `legato keys create` makes it",
            action="correct the path, the permissions or the file",
        )


class BadGrants(ConfigError):
    """A file of rights in some cells that cannot be used."""

    code = "E-GRANTS"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"rights in {path}: {problem}",
            expected="expected a file as `legato certs add --cell` and `revoke` write it",
            action="correct the path or the permissions, or bring back a copy (docs/security.md)",
        )


class NotRevocable(ConfigError):
    """A certificate that the router cannot tell from others of its role."""

    code = "E-NOT-REVOCABLE"

    def __init__(self, name: str, role: str) -> None:
        self.name = name
        self.role = role
        super().__init__(
            f"the certificate {name} is one of many with the rights of {role}",
            expected="expected one that was made with --cell, which has a name of its own",
            action="make a new authority (legato certs create --out NEW), give every process "
            "its folder from there and start all again (docs/security.md)",
        )


class Exposed(ConfigError):
    """A listener that others could reach without saying who they are."""

    code = "E-EXPOSED"

    def __init__(self, what: str, host: str, *, protection: str, consent: str) -> None:
        self.what = what
        self.host = host
        self.protection = protection
        self.consent = consent
        super().__init__(
            f"{what} at {host or 'every address'} would be open to whoever reaches it",
            expected=f"expected {protection}, or an address of this machine alone (127.0.0.1)",
            action=f"give one of them, or {consent} if something else keeps others out",
        )


class AccessError(LegatoError):
    """A call that its caller may not make."""

    code = "E-ACCESS"
    http_status = 403


class KeyRefused(AccessError):
    """No API key, or not one that counts."""

    code = "E-KEY"
    http_status = 401

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(
            problem,
            expected="expected the header Authorization: Bearer KEY of a key that counts",
            action="for the command legato: set LEGATO_API_KEY or LEGATO_API_KEY_FILE",
        )


class RoleTooLow(AccessError):
    """A key that may do less than this."""

    code = "E-ROLE"

    def __init__(self, name: str, role: str, needed: str) -> None:
        self.name = name
        self.role = role
        self.needed = needed
        super().__init__(
            f"the key {name} has the role {role}",
            expected=f"expected the role {needed}",
            action="use a key of that role",
        )


class ForeignPage(AccessError):
    """A web page of elsewhere that calls without a key, by the browser of someone who may."""

    code = "E-ORIGIN"

    def __init__(self, origin: str) -> None:
        self.origin = origin
        super().__init__(
            f"a page of {origin} made this call",
            expected="expected a page of this machine, as there are no keys",
            action="close that page; pages of other machines need --api-keys-file",
        )


class TooManyCalls(AccessError):
    """More writing calls of one caller than the control plane takes."""

    code = "E-TOO-MANY-CALLS"
    http_status = 429

    def __init__(self, caller: str, rate_hz: float, retry_after_s: int) -> None:
        self.caller = caller
        self.rate_hz = rate_hz
        self.retry_after_s = retry_after_s
        super().__init__(
            f"too many calls by {caller}",
            expected=f"expected at most {rate_hz:g} writing calls a second",
            action=f"wait {retry_after_s} s",
        )


class ContractError(LegatoError):
    """Two processes do not agree on a message."""

    code = "E-CONTRACT"
    http_status = 502


class SchemaMismatch(ContractError):
    """A message whose schema or version is not the topic's."""

    code = "E-SCHEMA"

    def __init__(self, topic: str, expected: str, got: str) -> None:
        self.topic = topic
        self.expected_schema = expected
        self.got_schema = got
        super().__init__(
            f"{topic}: message of schema {got or '(none)'}",
            expected=f"expected {expected}",
            action="run the same version of LEGATO in every process",
        )


class MalformedMessage(ContractError):
    """Bytes of the right schema that do not decode or validate."""

    code = "E-MALFORMED"

    def __init__(self, topic: str, schema: str, problem: str) -> None:
        self.topic = topic
        self.schema = schema
        self.problem = problem
        super().__init__(
            f"{topic}: {problem}",
            expected=f"expected a valid {schema}",
            action="look at the sender; the message was dropped",
        )


class ForeignMessage(ContractError):
    """A message that speaks of another cell or node than the one on whose key it came.

    Rights go by keys: believed, it would carry them further.
    """

    code = "E-FOREIGN"

    def __init__(self, topic: str, owner: str, spoken_of: str) -> None:
        self.topic = topic
        self.owner = owner
        self.spoken_of = spoken_of
        super().__init__(
            f"{topic} of {owner} speaks of {spoken_of or 'nobody'}",
            expected=f"expected it to speak of {owner}",
            action="look at the sender; the message was dropped",
        )


class WrongShape(ContractError):
    """An array that is too short or too long for the robot."""

    code = "E-SHAPE"

    def __init__(self, what: str, expected: int, got: int) -> None:
        self.what = what
        self.expected_length = expected
        self.got_length = got
        super().__init__(
            f"{what} has {got} values",
            expected=f"expected {expected}",
            action="check that both sides use the same robot",
        )


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


class LinkError(LegatoError):
    """A process that cannot be reached or is not ready."""

    code = "E-LINK"
    http_status = 503


class RouterUnreachable(LinkError):
    """No Zenoh router answers at the endpoint."""

    code = "E-ROUTER"

    def __init__(self, endpoint: str, after_s: float) -> None:
        self.endpoint = endpoint
        self.after_s = after_s
        super().__init__(
            f"no router at {endpoint} after {after_s:.1f} s",
            expected="expected a running LEGATO router",
            action="run: legato up",
        )


class RouterRefused(RouterUnreachable):
    """No encrypted link to the router; Zenoh itself says only that it could not connect."""

    code = "E-ROUTER-TLS"

    def __init__(self, endpoint: str, after_s: float, problem: str) -> None:
        self.endpoint = endpoint
        self.after_s = after_s
        self.problem = problem
        LinkError.__init__(
            self,
            f"no encrypted link to {endpoint} after {after_s:.1f} s: {problem}",
            expected="expected a router with certificates of the same authority",
            action="check that it runs with --certs, that its certificate has this host name, "
            "that both ca.pem are equal, and the clocks (docs/security.md)",
        )


class NotReady(LinkError):
    """A service that an evaluation needs is not running."""

    code = "E-NOT-READY"

    def __init__(self, needed: str, running: Sequence[str]) -> None:
        self.needed = needed
        self.running = tuple(running)
        super().__init__(
            f"{needed} is not running",
            expected=f"running: {', '.join(self.running) or 'nothing'}",
            action="start it with: legato up",
        )


class NodeTimeout(LinkError):
    """A process that did not answer in time."""

    code = "E-NODE-TIMEOUT"
    http_status = 504

    def __init__(self, node: str, waited_for: str, after_s: float) -> None:
        self.node = node
        self.waited_for = waited_for
        self.after_s = after_s
        super().__init__(
            f"{node} sent no {waited_for} for {after_s:.1f} s",
            expected=f"expected {waited_for} from {node}",
            action=f"look at the log of {node}",
        )


class AlreadyRunning(LinkError):
    """A second process where only one may be."""

    code = "E-ALREADY-RUNNING"
    http_status = 409

    def __init__(self, what: str, where: str) -> None:
        self.what = what
        self.where = where
        super().__init__(
            f"{what} is already running in {where}",
            expected="expected to be the only one",
            action="stop it with: legato down, or choose another --namespace",
        )


class PortInUse(LinkError):
    """A TCP port that something else listens on."""

    code = "E-PORT-IN-USE"
    http_status = 409

    def __init__(self, purpose: str, host: str, port: int) -> None:
        self.purpose = purpose
        self.host = host
        self.port = port
        super().__init__(
            f"port {port} on {host} ({purpose}) is in use",
            expected="expected a free port",
            action="stop what listens there, or choose another port",
        )


class SafetyError(LegatoError):
    """Why a robot was stopped and may not move."""

    code = "E-SAFETY"
    http_status = 409


class EmergencyStopped(SafetyError):
    """Somebody pressed the emergency stop of a cell."""

    code = "E-EMERGENCY-STOP"

    def __init__(self, cell: str, by: str, reason: str) -> None:
        self.cell = cell
        self.by = by
        self.reason = reason
        super().__init__(
            f"emergency stop of {cell} by {by}" + (f" ({reason})" if reason else ""),
            expected="the robot holds its pose until it is reset",
            action=f"when it is safe to move, run: legato reset --cell {cell}",
        )


class StaleCommand(SafetyError):
    """Real time: no joint command that is young enough; the robot was braked."""

    code = "E-STALE-COMMAND"

    def __init__(self, age_s: float, limit_s: float) -> None:
        self.age_s = age_s
        self.limit_s = limit_s
        super().__init__(
            f"the newest joint command is {1e3 * age_s:.0f} ms old",
            expected=f"expected one of the last {1e3 * limit_s:.0f} ms",
            action="look at the retargeter and the link to it; the robot holds its pose",
        )


class StoreError(LegatoError):
    """Results that cannot be read or written."""

    code = "E-STORE"


class NotFound(StoreError):
    """An evaluation or picture that does not exist."""

    code = "E-NOT-FOUND"
    http_status = 404

    def __init__(self, kind: str, identifier: str, *, listed_at: str | None = None) -> None:
        self.kind = kind
        self.identifier = identifier
        super().__init__(
            f'no {kind} "{identifier}"',
            expected=f"expected the id of an existing {kind}",
            action=f"list them with: GET {listed_at or f'/api/v1/{kind}s'}",
        )


class NotWritable(StoreError):
    """A database or folder that cannot be written."""

    code = "E-NOT-WRITABLE"

    def __init__(self, path: str, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(
            f"cannot write {path}: {problem}",
            expected="expected a writable file in an existing folder",
            action="correct the permissions or choose another --data folder",
        )
