"""The desk in the browser: for one person on this machine, who has the address with its token.

Every address holds the token, so nothing can be seen or decided without it, nor by a page of another origin that does
not know it; what changes something must come from the desk's own pages besides. Names and ids are looked up among
those that are known, and never make a path. What students wrote is shown where no script can run.
"""

from __future__ import annotations

import hmac
import json
import secrets
import socket
from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass, field
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import TypeAdapter, ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from grader.classroom.regrade import Regrade
from grader.desk.decisions import ChangedSince, Decision, Desk
from grader.desk.queue import Item
from grader.desk.rubric_edit import edited, limits_of, save, would_change
from grader.errors import GraderError, RubricError, UsageError
from grader.judging.judgement import evidence_of, prepare
from grader.judging.rubrics import recorded_rubric, rubric_copy
from grader.lab.rubric import Rubric
from grader.report import views
from grader.report.escape import shown
from grader.result import WHOLE, Result
from grader.result_folder import RECORDINGS, REPORT_FILE

LOOPBACK = "127.0.0.1"
_PAGES = Path(__file__).parent / "pages"
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
_MOST_BYTES = 1 << 20
_VALUES = TypeAdapter(dict[str, str])
#: The desk's own pages load their own files, and ask their own server, only.
_OWN_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; frame-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
#: Pages made of what students wrote: no script, no request, nothing but their own style.
_STUDENTS_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'; "
    "sandbox allow-same-origin"
)
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


@dataclass
class Server:
    """The addresses of a desk."""

    desk: Desk
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    def app(self, host: str) -> ASGIApp:
        """Return the application, which answers at one `host:port` only."""
        routes = [
            Route("/{token}/", self._page, methods=["GET"]),
            Route("/{token}/{file:str}.{ending:str}", self._file, methods=["GET"]),
            Route("/{token}/queue", self._queue, methods=["GET"]),
            Route("/{token}/evidence", self._evidence, methods=["GET"]),
            Route("/{token}/report", self._report, methods=["GET"]),
            Route("/{token}/preview", self._preview, methods=["POST"]),
            Route("/{token}/decide", self._decide, methods=["POST"]),
            Route("/{token}/undo", self._undo, methods=["POST"]),
            Route("/{token}/rubric", self._limits, methods=["GET"]),
            Route("/{token}/rubric/preview", self._rubric_preview, methods=["POST"]),
            Route("/{token}/rubric/save", self._rubric_save, methods=["POST"]),
        ]
        return _Guard(Starlette(routes=routes), host, self.token)

    async def _page(self, request: Request) -> Response:
        return _answer((_PAGES / "desk.html").read_bytes(), ".html")

    async def _file(self, request: Request) -> Response:
        name = f"{request.path_params['file']}.{request.path_params['ending']}"
        there = {path.name: path for path in _PAGES.iterdir()}
        return (
            _answer(there[name].read_bytes(), there[name].suffix) if name in there else _not_found()
        )

    async def _queue(self, request: Request) -> Response:
        return _json(self._state)

    def _state(self) -> dict[str, Any]:
        desk = self.desk
        by_id = {check.id: check for check in desk.rubric.checks()}
        items = []
        for item in desk.queue():
            spec = by_id.get(item.part.id)
            items.append(
                {
                    **_plain(item),
                    "levels": [level.model_dump() for level in spec.levels] if spec else [],
                }
            )
        return {
            "lab": f"Lab {desk.rubric.lab.id}: {desk.rubric.lab.title}",
            "who": desk.who,
            "items": items,
            "criteria": {criterion.id: criterion.title for criterion in desk.rubric.criteria},
            "written": len(desk.written),
            **desk.offered(),
            **desk.settle(),
        }

    async def _evidence(self, request: Request) -> Response:
        name, what = request.query_params.get("name", ""), request.query_params.get("what", "")
        result, folder = self._of(name, RECORDINGS)
        if result is None or what not in {
            WHOLE,
            *(c.id for c in result.criteria),
            *(c.id for c in result.checks),
        }:
            return _not_found()
        own = result.rubric_sha256 in ("", self.desk.rubric.sha256)
        try:
            rubric = self.desk.rubric if own else _recorded(rubric_copy(folder.parent))
            page = evidence_of(result, folder, rubric, what)
        except (GraderError, OSError) as error:
            page = f"<!DOCTYPE html><title>Evidence</title><p>There is no evidence to show: {_escaped(error)}</p>"
        return _answer(page.encode("utf-8", "replace"), ".html", _STUDENTS_POLICY)

    async def _report(self, request: Request) -> Response:
        result, path = self._of(request.query_params.get("name", ""), REPORT_FILE)
        if result is None or not path.is_file():
            return _not_found()
        return _answer(path.read_bytes(), ".html", _STUDENTS_POLICY)

    def _of(self, name: str, file: str) -> tuple[Result | None, Path]:
        """Return a submission's result, None if there is none or a link leads out of the class, and a path beside."""
        result = self.desk.judged().get(name)
        path = self.desk.folder_of(name) / file if result is not None else Path()
        return result if path.resolve() == path else None, path

    async def _preview(self, request: Request) -> Response:
        decision = await _decision(request)
        return _json(
            lambda: {"effects": [_plain(effect) for effect in self.desk.preview(decision())]}
        )

    async def _decide(self, request: Request) -> Response:
        decision = await _decision(request)

        def decide() -> dict[str, Any]:
            self.desk.decide(decision())
            return self._state()

        return _json(decide)

    async def _undo(self, request: Request) -> Response:
        def undo() -> dict[str, Any]:
            return {
                "taken_back": self.desk.undo().model_dump(include={"names", "id"}),
                **self._state(),
            }

        return _json(undo)

    async def _limits(self, request: Request) -> Response:
        return _json(lambda: {"limits": [asdict(limit) for limit in limits_of(self.desk.rubric)]})

    async def _rubric_preview(self, request: Request) -> Response:
        text = await self._edited(request)
        return _json(
            lambda: _changes(would_change(self.desk.results, text(), self.desk.overrides()))
        )

    async def _rubric_save(self, request: Request) -> Response:
        text = await self._edited(request)
        return _json(lambda: {"saved": str(save(self.desk.results, text()))})

    async def _edited(self, request: Request) -> Callable[[], str]:
        body = await request.body()
        return lambda: edited(self.desk.rubric.text, _VALUES.validate_json(body))


def _changes(found: Regrade) -> dict[str, Any]:
    """Return who changes, those that change most first."""
    changed = [(name, each) for name, each in found.changes.items() if each.matters]
    rows = [
        {
            "name": name,
            "before": each.before,
            "after": each.after,
            "difference": views.signed(each.difference),
            "parts": [f"{part.title} {views.signed(part.difference)}" for part in each.at("check")],
        }
        for name, each in sorted(changed, key=lambda pair: (-abs(pair[1].difference), pair[0]))
    ]
    return {"judged": len(found.judged), "failed": sorted(found.failed), "changes": rows}


async def _decision(request: Request) -> Callable[[], Decision]:
    body = await request.body()
    return lambda: Decision.model_validate_json(body)


def _json(make: Callable[[], dict[str, Any]]) -> Response:
    """Answer with what is made, or with what is wrong: 409 if somebody else was quicker, 400 otherwise."""
    try:
        return _answer(json.dumps(make(), default=_number).encode(), ".json")
    except ValidationError as error:
        problem, mistakes, remedy = (
            "this is not a decision",
            [str(e["msg"]) for e in error.errors()][:5],
            "",
        )
        status = 400
    except GraderError as error:
        problem, remedy, status = (
            error.problem,
            error.remedy,
            409 if isinstance(error, ChangedSince) else 400,
        )
        mistakes = list(error.mistakes) if isinstance(error, RubricError) else []
    reported = {"problem": problem, "mistakes": mistakes, "remedy": remedy}
    return _answer(json.dumps(reported).encode(), ".json", status=status)


def _plain(value: Any) -> dict[str, Any]:
    """Return an item or an effect as the page knows it, its texts fit to be shown but for what it sends back."""
    plain = asdict(value)
    plain["text"] = shown(plain["text"])
    if isinstance(value, Item):
        plain |= {"id": value.id, "kind": value.kind.value}
    return plain


def _number(value: Any) -> Any:
    return views.points(value) if isinstance(value, Decimal) else list(value)


def _answer(content: bytes, ending: str, policy: str = _OWN_POLICY, status: int = 200) -> Response:
    kind = _TYPES.get(ending, "application/json")
    return Response(
        content, status, headers={**_HEADERS, "Content-Security-Policy": policy}, media_type=kind
    )


def _not_found() -> Response:
    return Response("There is no such page.", 404, headers=_HEADERS, media_type="text/plain")


def _escaped(error: Exception) -> str:
    from markupsafe import escape

    return str(escape(shown(str(error))))


@lru_cache(maxsize=4)
def _recorded(copy: Path) -> Rubric:
    return recorded_rubric(copy)


class _Guard:
    """Lets through what comes from somebody who has the token, at the address that the desk gave, and nothing else."""

    def __init__(
        self, app: Callable[[Scope, Receive, Send], Awaitable[None]], host: str, token: str
    ) -> None:
        self._app, self._host, self._token = app, host, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        refused = _not_found() if scope["type"] != "http" else self._refusal(Request(scope))
        await (refused or self._app)(scope, receive, send)

    def _refusal(self, request: Request) -> Response | None:
        given = request.url.path.split("/")[1]
        # A name that leads here by a foreign name server is none of ours.
        if request.headers.get("host") != self._host:
            return _not_found()
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode()):
            return _not_found()
        if request.method == "GET":
            return None
        own = request.headers.get("origin") == f"http://{self._host}"
        is_json = request.headers.get("content-type", "").partition(";")[0] == "application/json"
        length = request.headers.get("content-length", "")
        small = length.isdecimal() and int(length) <= _MOST_BYTES
        if (
            own
            and is_json
            and small
            and request.headers.get("sec-fetch-site", "same-origin") == "same-origin"
        ):
            return None
        return Response(
            "Only the desk's own pages may do this.", 403, headers=_HEADERS, media_type="text/plain"
        )


def serve(desk: Desk, port: int, on_ready: Callable[[str], None]) -> None:
    """Serve a desk to this machine alone until Ctrl-C, at a port, or at a free one for 0; tells its address.

    Raises UsageError if the port cannot be used.
    """
    with socket.socket() as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((LOOPBACK, port))
            listening.listen()
        except (OSError, OverflowError) as error:
            raise UsageError(
                f"port {port} cannot be used: {error}", remedy="Leave out --port, or name another."
            ) from error
        host = f"{LOOPBACK}:{listening.getsockname()[1]}"
        server = Server(desk)
        # Its log would hold the token.
        settings = uvicorn.Config(
            server.app(host), log_level="error", access_log=False, server_header=False
        )
        prepare(
            desk.rubric
        )  # so that each piece of evidence, made in a copy of this process, is there sooner
        desk.settle()
        on_ready(f"http://{host}/{server.token}/")
        uvicorn.Server(settings).run(sockets=[listening])
