"""The FastAPI application: routes, problems, limits."""

from __future__ import annotations

from fastapi import FastAPI

from common import __version__
from common.api import PREFIX
from services.control.body_limit import BodyLimit
from services.control.plane import ControlPlane
from services.control.problems import add_problem_handlers
from services.control.routes import api, health


def create_app(plane: ControlPlane) -> FastAPI:
    """The application in front of a control plane."""
    app = FastAPI(
        title="LEGATO control plane",
        version=__version__,
        openapi_url=f"{PREFIX}/openapi.json",
        # The ready-made pages load their scripts from outside hosts.
        docs_url=None,
        redoc_url=None,
    )
    app.state.plane = plane
    app.add_middleware(BodyLimit)
    add_problem_handlers(app)
    app.include_router(api)
    app.include_router(health)
    # The same under the prefix, for those who reach only that through a proxy.
    app.include_router(health, prefix=PREFIX)
    return app
