"""A process that cannot be reached or is not ready."""

from __future__ import annotations

from collections.abc import Sequence

from common.errors.base import LegatoError


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
