"""The dashboard of workers in this process, for who started them: its address has a word that nobody guesses.

Dask's own answers whoever reaches its port: other users of this machine, and pages of the web under names of theirs that lead here.
"""

from __future__ import annotations

import secrets
from typing import Any

__all__ = ["LOOPBACK", "guard", "local_dashboard", "new_prefix"]

LOOPBACK = "127.0.0.1"
HOSTS = (LOOPBACK, "localhost")
"""As who sits here names it, or comes through a tunnel."""


def new_prefix() -> str:
    """What paths of a dashboard begin with, for ``http_prefix`` of Dask's scheduler."""
    return f"/status-{secrets.token_urlsafe(16)}"


def guard(cluster: Any, prefix: str) -> None:
    """Let a cluster within this process answer requests for this machine by its name alone, and below the prefix.

    Args:
        cluster: a ``LocalCluster`` without processes. Its workers answer none; the scheduler shows what they do.
    """
    from tornado.routing import Matcher, Rule
    from tornado.web import HTTPError, RequestHandler

    class Foreign(Matcher):
        """Requests that are refused."""

        def match(self, request: Any) -> dict[str, Any] | None:
            ours = request.host_name in HOSTS and request.path.startswith(f"{prefix}/")
            return None if ours else {}

    class Refused(RequestHandler):
        def prepare(self) -> None:
            raise HTTPError(403)

    for node in (cluster.scheduler, *cluster.workers.values()):
        node.http_application.default_router.rules.insert(0, Rule(Foreign(), Refused))


def local_dashboard(client: Any, prefix: str) -> str | None:
    """Address of the dashboard; Dask itself says one that the network would know. None = none."""
    port = client.scheduler_info()["services"].get("dashboard")
    return f"http://{LOOPBACK}:{port}{prefix}/status" if port else None
