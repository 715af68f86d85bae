"""Every error as `application/problem+json` (RFC 9457)."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException

from common.api import ProblemDetails
from common.errors import KeyRefused, LegatoError, TooManyCalls
from services.control.plane import InvalidRequest

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"

_HTTP_CODES = {
    400: ("E-BODY", "expected a body of JSON", "correct the body"),
    404: ("E-NOT-FOUND", "expected a path of the API", "see GET /api/v1/openapi.json"),
    405: ("E-METHOD", "expected a method of this path", "see GET /api/v1/openapi.json"),
    413: ("E-TOO-LARGE", "expected a smaller body", "send less, e.g. several evaluations"),
}
_OTHER = ("E-HTTP", "expected a request of the API", "see GET /api/v1/openapi.json")


def problem_response(
    status: int,
    *,
    code: str,
    detail: str,
    expected: str,
    action: str,
    errors: Sequence[Mapping[str, Any]] = (),
    headers: Mapping[str, str] | None = None,
) -> Response:
    """A response that says what happened, what was expected and what to do."""
    problem = ProblemDetails(
        type=f"urn:legato:error:{code}",
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        code=code,
        expected=expected,
        action=action,
        errors=[dict(error) for error in errors],
    )
    return Response(
        problem.model_dump_json(), status_code=status, media_type=MEDIA_TYPE, headers=headers
    )


def add_problem_handlers(app: FastAPI) -> None:
    """Translate every exception; none leaves the application as anything else."""
    app.add_exception_handler(LegatoError, _from_legato_error)
    app.add_exception_handler(RequestValidationError, _from_validation)
    app.add_exception_handler(HTTPException, _from_http)
    app.add_exception_handler(Exception, _from_unexpected)


async def _from_legato_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, LegatoError)
    if error.http_status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        log.warning("request failed", extra={"path": request.url.path, **error.describe()})
    said = error.describe()
    fields = error.errors if isinstance(error, InvalidRequest) else []
    return problem_response(
        error.http_status,
        code=said["code"],
        detail=said["happened"],
        expected=said["expected"],
        action=said["action"],
        errors=[{"field": field, **one.describe()} for field, one in fields],
        headers=_headers_of(error),
    )


def _headers_of(error: LegatoError) -> dict[str, str]:
    """What HTTP says beside some status codes."""
    if isinstance(error, KeyRefused):
        return {"WWW-Authenticate": 'Bearer realm="legato"'}
    if isinstance(error, TooManyCalls):
        return {"Retry-After": str(error.retry_after_s)}
    return {}


async def _from_validation(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    found = error.errors()
    if any(one["type"] == "json_invalid" for one in found):
        return http_problem(400, f"the body is not JSON: {found[0]['ctx']['error']}")
    errors = [_describe_field(one) for one in found]
    first = errors[0]
    return problem_response(
        422,
        code=first["code"],
        detail=first["happened"],
        expected=first["expected"],
        action=first["action"],
        errors=errors,
    )


def _describe_field(error: Mapping[str, Any]) -> dict[str, str]:
    """One field that does not validate, in the words of an `InvalidValue`."""
    field = ".".join(str(part) for part in error["loc"][1:]) or str(error["loc"][0])
    message = str(error["msg"])
    given = "is missing" if error["type"] == "missing" else f"is {_shorten(error.get('input'))}"
    return {
        "field": field,
        "code": "E-INVALID-VALUE",
        "happened": f"{field} {given}",
        "expected": message[:1].lower() + message[1:],
        "action": f"change {field}",
    }


def _shorten(value: object, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else f"{text[:limit]}…"


async def _from_http(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return http_problem(error.status_code, str(error.detail), headers=error.headers)


def http_problem(status: int, detail: str, *, headers: Mapping[str, str] | None = None) -> Response:
    """An error of HTTP itself: path, method, size or form of the body."""
    code, expected, action = _HTTP_CODES.get(status, _OTHER)
    return problem_response(
        status, code=code, detail=detail, expected=expected, action=action, headers=headers
    )


async def _from_unexpected(request: Request, error: Exception) -> Response:
    log.error("unexpected error", extra={"path": request.url.path}, exc_info=error)
    return problem_response(
        500,
        code="E-INTERNAL",
        detail="the control plane failed",
        expected="expected this not to happen",
        action="look at the log of control",
    )
