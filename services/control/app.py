"""The FastAPI application: routes, keys, problems, limits."""

from __future__ import annotations

from fastapi import FastAPI

from common import __version__
from common.api import PREFIX
from services.control.access import Guard
from services.control.audit import Audit
from services.control.body_limit import BodyLimit
from services.control.keyring import KeyRing
from services.control.plane import ControlPlane
from services.control.problems import add_problem_handlers
from services.control.rate_limit import RateLimit
from services.control.routes import api, health


def create_app(
    plane: ControlPlane, *, keys: KeyRing | None = None, limit: RateLimit | None = None
) -> FastAPI:
    """The application in front of a control plane.

    Args:
        plane: What the routes work with.
        keys: Keys that count; without them everybody may do everything.
        limit: Bounds the writing calls of each caller; without it the usual one.
    """
    app = FastAPI(
        title="LEGATO control plane",
        version=__version__,
        # A route of our own serves it, to those who may see the rest.
        openapi_url=None,
        # The ready-made pages load their scripts from outside hosts.
        docs_url=None,
        redoc_url=None,
    )
    app.state.plane = plane
    app.state.guard = Guard(keys, limit or RateLimit())
    app.add_middleware(BodyLimit)
    app.add_middleware(Audit)
    add_problem_handlers(app)
    app.include_router(api)
    app.include_router(health)
    # The same under the prefix, for those who reach only that through a proxy.
    app.include_router(health, prefix=PREFIX)
    return app
