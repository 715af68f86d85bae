"""The resources of REST."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from common.api import (
    PREFIX,
    CellInfo,
    Evaluation,
    EvaluationRequest,
    PolicyInfo,
    PolicyLoadRequest,
    ResetRequest,
    RobotInfo,
    ServiceInfo,
    StopRequest,
    TaskInfo,
    Trial,
)
from common.errors import NotReady
from common.messages.base import Name
from services.control import sse
from services.control.access import ADMIN, OPEN, OPERATE, STOP, VIEW, GuardedRoute
from services.control.plane import Plane

LARGEST_INT = 2**63 - 1

TrialNumber = Annotated[int, Path(ge=0, le=LARGEST_INT)]

api = APIRouter(prefix=PREFIX, route_class=GuardedRoute)
health = APIRouter(route_class=GuardedRoute)


@api.post("/evaluations", status_code=status.HTTP_202_ACCEPTED, openapi_extra=OPERATE)
def post_evaluation(request: EvaluationRequest, response: Response, plane: Plane) -> Evaluation:
    """Start an evaluation."""
    evaluation = plane.submit(request)
    response.headers["Location"] = f"{PREFIX}/evaluations/{evaluation.id}"
    return evaluation


@api.get("/evaluations", openapi_extra=VIEW)
def get_evaluations(
    plane: Plane,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    offset: Annotated[int, Query(ge=0, le=LARGEST_INT)] = 0,
) -> list[Evaluation]:
    """Evaluations, newest first."""
    return plane.queries.evaluations(plane.deployment.waiting, limit=limit, offset=offset)


@api.get("/evaluations/{evaluation}", openapi_extra=VIEW)
def get_evaluation(evaluation: Name, plane: Plane) -> Evaluation:
    """One evaluation as it is now."""
    return plane.evaluation(evaluation)


@api.delete(
    "/evaluations/{evaluation}", status_code=status.HTTP_202_ACCEPTED, openapi_extra=OPERATE
)
def delete_evaluation(evaluation: Name, plane: Plane) -> Evaluation:
    """Stop an evaluation; what has ended stays. One that is over is left as it is."""
    return plane.cancel(evaluation)


@api.get("/evaluations/{evaluation}/trials", openapi_extra=VIEW)
def get_trials(evaluation: Name, plane: Plane) -> list[Trial]:
    """The trials of an evaluation, in order."""
    return plane.queries.trials(evaluation)


@api.get(
    "/evaluations/{evaluation}/trials/{trial}/pictures/{name}",
    response_class=Response,
    responses={200: {"content": {"image/png": {}}}},
    openapi_extra=VIEW,
)
def get_picture(evaluation: Name, trial: TrialNumber, name: Name, plane: Plane) -> Response:
    """A picture of a trial's key moment."""
    return Response(plane.queries.picture(evaluation, trial, name), media_type="image/png")


@api.get(
    "/evaluations/{evaluation}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {sse.MEDIA_TYPE: {}}}},
    openapi_extra=VIEW,
)
async def get_events(evaluation: Name, plane: Plane) -> StreamingResponse:
    """Follow an evaluation: its state now, then one event per change."""
    # Here, not in the stream: an unknown id is a 404.
    await run_in_threadpool(plane.evaluation, evaluation)
    return StreamingResponse(
        sse.follow(plane, evaluation),
        media_type=sse.MEDIA_TYPE,
        headers={"Cache-Control": "no-store"},
    )


@api.get("/robots", openapi_extra=VIEW)
def get_robots(plane: Plane) -> list[RobotInfo]:
    """Robots the code knows, and whether a retargeter runs for each."""
    running = plane.deployment.robots()
    return [
        RobotInfo(
            name=robot.name,
            title=robot.title,
            degrees_of_freedom=robot.degrees_of_freedom,
            available=robot.name in running,
        )
        for robot in plane.catalog.robots
    ]


@api.get("/tasks", openapi_extra=VIEW)
def get_tasks(plane: Plane) -> list[TaskInfo]:
    """Tasks the code knows."""
    return list(plane.catalog.tasks)


@api.get("/policies", openapi_extra=VIEW)
def get_policies(plane: Plane) -> list[PolicyInfo]:
    """Policies that running policy services offer."""
    return plane.deployment.policies()


@api.put("/policies/{name}", openapi_extra=ADMIN)
def put_policy(name: Name, request: PolicyLoadRequest, plane: Plane) -> PolicyInfo:
    """Load a checkpoint under a name, or another one in its place; running episodes keep theirs."""
    return plane.load_policy(name, request)


@api.get("/cells", openapi_extra=VIEW)
def get_cells(plane: Plane) -> list[CellInfo]:
    """The cells and what their guards say."""
    return list(plane.deployment.cells.infos)


@api.post("/stop", openapi_extra=STOP)
def post_stop(request: StopRequest, plane: Plane) -> list[CellInfo]:
    """Emergency stop: the cells' robots brake and hold until they are reset."""
    return plane.stop_cells(request)


@api.post("/reset", openapi_extra=OPERATE)
def post_reset(request: ResetRequest, plane: Plane) -> list[CellInfo]:
    """Release what is latched in cells whose robots are at rest."""
    return plane.reset_cells(request)


@api.get("/services", openapi_extra=VIEW)
def get_services(plane: Plane) -> list[ServiceInfo]:
    """Nodes on the bus, also those that were lost."""
    return list(plane.deployment.nodes)


@api.get("/openapi.json", include_in_schema=False, openapi_extra=VIEW)
def get_schema(request: Request) -> dict[str, Any]:
    """The schema of this API."""
    return request.app.openapi()


@health.get("/healthz", openapi_extra=OPEN)
def get_health() -> dict[str, str]:
    """The process answers."""
    return {"status": "alive"}


@health.get("/readyz", openapi_extra=OPEN)
def get_readiness(plane: Plane) -> dict[str, str]:
    """Whether an evaluation can run now."""
    missing = plane.deployment.missing()
    if missing:
        raise NotReady(", ".join(missing), plane.deployment.running)
    return {"status": "ready"}
