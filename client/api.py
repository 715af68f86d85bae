"""The typed client of the REST API: ten lines of Python run an evaluation."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar

import httpx
from pydantic import TypeAdapter, ValidationError

from client.credentials import find_api_key
from client.errors import ControlUnreachable, NotLegato, RestError
from client.sse import parse_events
from common.api import (
    PREFIX,
    CellInfo,
    Evaluation,
    EvaluationRequest,
    PolicyInfo,
    PolicyLoadRequest,
    ProblemDetails,
    ProgressEvent,
    ResetRequest,
    RobotInfo,
    ServiceInfo,
    StopRequest,
    TaskInfo,
    Trial,
)
from common.errors import LinkError

DEFAULT_URL = "http://127.0.0.1:8000"
LOAD_TIMEOUT_S = 90.0
"""Longer than the control plane itself waits for a policy service."""

_Answer = TypeVar("_Answer")


class LegatoClient:
    """Talks to one control plane. Use it as a context manager.

    Every method raises `RestError` for what the control plane refuses, `ControlUnreachable` when
    nothing answers and `NotLegato` when something else does.

    Args:
        base_url: Where the control plane listens.
        api_key: Key of the caller; without it that of the environment (`LEGATO_API_KEY`, or the
            file that `LEGATO_API_KEY_FILE` names), if any.
        transport: Replaces the network, in tests.
        timeout_s: Longest wait for one answer [s].
        reconnect_s: How long a broken stream of events is opened again before it counts as
            lost [s].
    """

    def __init__(
        self,
        base_url: str = DEFAULT_URL,
        *,
        api_key: str | None = None,
        transport: httpx.BaseTransport | None = None,
        timeout_s: float = 10.0,
        reconnect_s: float = 30.0,
    ) -> None:
        self.base_url = base_url.rstrip("/")
        self._reconnect_s = reconnect_s
        key = api_key or find_api_key(os.environ)
        self._http = httpx.Client(
            base_url=self.base_url,
            headers={} if key is None else {"Authorization": f"Bearer {key}"},
            transport=transport,
            timeout=timeout_s,
            # A proxy of the environment must not stand between two processes of one machine.
            trust_env=False,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def submit(self, request: EvaluationRequest) -> Evaluation:
        """Start an evaluation."""
        body = request.model_dump(mode="json", exclude_none=True)
        return self._call("POST", "/evaluations", Evaluation, json=body)

    def evaluations(self) -> list[Evaluation]:
        """All evaluations."""
        return self._call("GET", "/evaluations", list[Evaluation])

    def evaluation(self, identifier: str) -> Evaluation:
        """One evaluation as it is now."""
        return self._call("GET", f"/evaluations/{identifier}", Evaluation)

    def trials(self, identifier: str) -> list[Trial]:
        """The trials of an evaluation, in order."""
        return self._call("GET", f"/evaluations/{identifier}/trials", list[Trial])

    def cancel(self, identifier: str) -> Evaluation:
        """Stop an evaluation; what is done stays."""
        return self._call("DELETE", f"/evaluations/{identifier}", Evaluation)

    def picture(self, evaluation: str, trial: int, name: str) -> bytes:
        """One picture of a trial, as PNG."""
        path = f"{PREFIX}/evaluations/{evaluation}/trials/{trial}/pictures/{name}"
        return self._send("GET", path).content

    def robots(self) -> list[RobotInfo]:
        """Robots the code knows, and whether a retargeter runs for each."""
        return self._call("GET", "/robots", list[RobotInfo])

    def tasks(self) -> list[TaskInfo]:
        """Tasks the code knows."""
        return self._call("GET", "/tasks", list[TaskInfo])

    def policies(self) -> list[PolicyInfo]:
        """Policies that running policy services offer."""
        return self._call("GET", "/policies", list[PolicyInfo])

    def load_policy(self, name: str, folder: str, *, node: str | None = None) -> PolicyInfo:
        """Load a checkpoint of the policy host under a name, in place of one that has it.

        Args:
            name: What evaluations call it.
            folder: On the policy host.
            node: Policy service; without it all that run.
        """
        body = PolicyLoadRequest(folder=folder, node=node).model_dump(mode="json")
        return self._call("PUT", f"/policies/{name}", PolicyInfo, json=body, timeout=LOAD_TIMEOUT_S)

    def services(self) -> list[ServiceInfo]:
        """Nodes on the bus."""
        return self._call("GET", "/services", list[ServiceInfo])

    def cells(self) -> list[CellInfo]:
        """The cells and what their guards say."""
        return self._call("GET", "/cells", list[CellInfo])

    def stop(self, cells: Sequence[str] | None = None, *, reason: str = "") -> list[CellInfo]:
        """Emergency stop; back when the guards have said that it is latched.

        Args:
            cells: Names; without it all.
            reason: Shown with the trials that end by it.
        """
        named = None if cells is None else list(cells)
        body = StopRequest(cells=named, reason=reason).model_dump(mode="json")
        return self._call("POST", "/stop", list[CellInfo], json=body)

    def reset(self, cells: Sequence[str] | None = None) -> list[CellInfo]:
        """Release what is latched in cells whose robots are at rest.

        Args:
            cells: Names; without it all.
        """
        body = ResetRequest(cells=None if cells is None else list(cells)).model_dump(mode="json")
        return self._call("POST", "/reset", list[CellInfo], json=body)

    def ready(self) -> bool:
        """Whether the control plane can take an evaluation now; False also when nothing answers."""
        try:
            return self._http.get("/readyz").is_success
        except httpx.TransportError:
            return False

    def events(self, identifier: str) -> Iterator[ProgressEvent]:
        """Follow an evaluation until it ends.

        A stream that breaks is opened again for up to `reconnect_s` after the last sign of life;
        every event carries the whole evaluation, so nothing is counted twice or missed.
        """
        heard_s = time.monotonic()
        pause_s = 0.1
        while True:
            problem = "the stream of events ended"
            try:
                for event in self._stream(f"/evaluations/{identifier}/events"):
                    heard_s, pause_s = time.monotonic(), 0.1
                    if event is None:
                        return
                    yield event
            except LinkError as error:
                problem = error.happened
            if time.monotonic() - heard_s > self._reconnect_s:
                raise ControlUnreachable(self.base_url, problem)
            time.sleep(pause_s)
            pause_s = min(2.0, 2 * pause_s)

    def wait(self, identifier: str) -> Evaluation:
        """Wait until an evaluation has ended and return it."""
        for _ in self.events(identifier):
            pass
        return self.evaluation(identifier)

    def _stream(self, path: str) -> Iterator[ProgressEvent | None]:
        """Events of one connection; None is the `end` event."""
        # The control plane sends comments while nothing happens: silence means it is gone.
        timeout = httpx.Timeout(10.0, read=30.0)
        try:
            with self._http.stream("GET", PREFIX + path, timeout=timeout) as response:
                if not response.is_success:
                    response.read()
                self._check(response)
                for event in parse_events(response.iter_lines()):
                    if event.name == "end":
                        yield None
                        return
                    yield self._validate(ProgressEvent, event.data, path)
        except httpx.TransportError as error:
            raise ControlUnreachable(self.base_url, _words(error)) from error

    def _call(self, method: str, path: str, answer: type[_Answer], **options: Any) -> _Answer:
        response = self._send(method, PREFIX + path, **options)
        return self._validate(answer, response.text, path)

    def _send(self, method: str, path: str, **options: Any) -> httpx.Response:
        try:
            response = self._http.request(method, path, **options)
        except httpx.TransportError as error:
            raise ControlUnreachable(self.base_url, _words(error)) from error
        self._check(response)
        return response

    def _check(self, response: httpx.Response) -> None:
        if response.is_success:
            return
        try:
            problem = ProblemDetails.model_validate_json(response.content)
        except ValidationError as error:
            raise NotLegato(
                self.base_url, f"{response.status_code} without problem details"
            ) from error
        raise RestError(problem)

    def _validate(self, answer: type[_Answer], text: str, path: str) -> _Answer:
        try:
            return TypeAdapter(answer).validate_json(text)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "body"
            raise NotLegato(self.base_url, f"{path} with {where}: {first['msg']}") from error


def _words(error: httpx.TransportError) -> str:
    """What went wrong, for people: the class name without `Error`, the system's words after it."""
    if isinstance(error, httpx.TimeoutException):
        return "no answer in time"
    if isinstance(error, httpx.ConnectError):
        return "connection refused" if "refused" in str(error) else str(error)
    return str(error) or type(error).__name__
