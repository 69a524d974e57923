"""The desk in the browser, for one person on this machine with the address and its token.

Every address contains the token; without it, neither a person nor a page of another origin can see or decide anything.
Requests that change something must also come from the desk's own pages. Names and ids are looked up among known ones,
and never become part of a path. Students' texts are shown on pages that run no script.
"""

from __future__ import annotations

import hmac
import json
import secrets
import shlex
import socket
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
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
from grader.desk.pasted import pasted_appeal
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
#: Bytes of the longest request.
_MOST_BYTES = 1 << 20
#: Mistakes of a request that are listed.
_MOST_MISTAKES = 5
_VALUES = TypeAdapter(dict[str, str])
#: Policy of the desk's own pages, which load only their own files, and call only their own server.
_OWN_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; frame-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)
#: Policy of pages with students' texts: no script, no request, only their own style.
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
            Route("/{token}/pasted", self._pasted, methods=["POST"]),
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
        for path in _PAGES.iterdir():
            if path.name == name:
                return _answer(path.read_bytes(), path.suffix)
        return _not_found()

    async def _queue(self, request: Request) -> Response:
        return _json(self._state)

    def _state(self) -> dict[str, Any]:
        desk = self.desk
        rubric = desk.rubric
        levels = {check.id: check.levels for check in rubric.checks()}
        items = []
        for item in desk.queue():
            plain = _plain(item)
            own = levels.get(item.part.id, ())
            plain["levels"] = [level.model_dump() for level in own]
            items.append(plain)
        state = {
            "lab": f"Lab {rubric.lab.id}: {rubric.lab.title}",
            "who": desk.who,
            "items": items,
            "criteria": {criterion.id: criterion.title for criterion in rubric.criteria},
            "written": len(desk.written),
        }
        return state | desk.offered() | desk.settle()

    async def _evidence(self, request: Request) -> Response:
        part = request.query_params.get("what", "")
        result, folder = self._of(request.query_params.get("name", ""), RECORDINGS)
        if result is None or not _has_part(result, part):
            return _not_found()
        own = result.rubric_sha256 in ("", self.desk.rubric.sha256)
        try:
            if own:
                rubric = self.desk.rubric
            else:
                rubric = _recorded(rubric_copy(folder.parent))
            page = evidence_of(result, folder, rubric, part)
        except (GraderError, OSError) as error:
            page = f"<!DOCTYPE html><title>Evidence</title><p>There is no evidence to show: {_escaped(error)}</p>"
        return _answer(page.encode("utf-8", "replace"), ".html", _STUDENTS_POLICY)

    async def _report(self, request: Request) -> Response:
        result, path = self._of(request.query_params.get("name", ""), REPORT_FILE)
        if result is None or not path.is_file():
            return _not_found()
        return _answer(path.read_bytes(), ".html", _STUDENTS_POLICY)

    def _of(self, name: str, file: str) -> tuple[Result | None, Path]:
        """Return a submission's result, and the path of a file beside it.

        The result is None if there is none, or if a link leads out of the class.
        """
        result = self.desk.judged().get(name)
        if result is None:
            return None, Path()
        path = self.desk.folder_of(name) / file
        if path.resolve() != path:
            return None, path
        return result, path

    async def _preview(self, request: Request) -> Response:
        decision = await _decision(request)

        def preview() -> dict[str, Any]:
            return {"effects": list(map(_plain, self.desk.preview(decision())))}

        return _json(preview)

    async def _decide(self, request: Request) -> Response:
        decision = await _decision(request)

        def decide() -> dict[str, Any]:
            self.desk.decide(decision())
            return self._state()

        return _json(decide)

    async def _pasted(self, request: Request) -> Response:
        body = await request.body()

        def note() -> dict[str, Any]:
            text = _VALUES.validate_json(body).get("text", "")
            results = self.desk.judged()
            appeal = pasted_appeal(text, results)
            (name,) = appeal.names
            # The student asks, but this desk can take it back.
            replace(self.desk, who=results[name].submission).decide(appeal)
            return {"pasted": {"name": name, "id": appeal.id}, **self._state()}

        return _json(note)

    async def _undo(self, request: Request) -> Response:
        def undo() -> dict[str, Any]:
            taken_back = self.desk.undo().model_dump(include={"names", "id"})
            return {"taken_back": taken_back, **self._state()}

        return _json(undo)

    async def _limits(self, request: Request) -> Response:
        return _json(lambda: {"limits": [asdict(limit) for limit in limits_of(self.desk.rubric)]})

    async def _rubric_preview(self, request: Request) -> Response:
        text = await self._edited(request)

        def preview() -> dict[str, Any]:
            return _changes(would_change(self.desk.results, text(), self.desk.overrides()))

        return _json(preview)

    async def _rubric_save(self, request: Request) -> Response:
        text = await self._edited(request)
        results = self.desk.results

        def saved() -> dict[str, str]:
            file = save(results, text())
            words = ["grade", "regrade", str(results), "--rubric", str(file), "--ask", "--mail"]
            return {"saved": str(file), "command": shlex.join(words)}

        return _json(saved)

    async def _edited(self, request: Request) -> Callable[[], str]:
        body = await request.body()
        return lambda: edited(self.desk.rubric.text, _VALUES.validate_json(body))


def _has_part(result: Result, part: str) -> bool:
    """Return whether a result has a criterion or a check with an id, or the id means the whole."""
    ids = {WHOLE}
    ids.update(criterion.id for criterion in result.criteria)
    ids.update(check.id for check in result.checks)
    return part in ids


def _changes(found: Regrade) -> dict[str, Any]:
    """Return the changed submissions, the largest changes first."""
    changed = [name for name, each in found.changes.items() if each.matters]
    changed.sort()
    changed.sort(key=lambda name: -abs(found.changes[name].difference))
    rows = []
    for name in changed:
        each = found.changes[name]
        parts = [f"{part.title} {views.signed(part.difference)}" for part in each.at("check")]
        rows.append(
            {
                "name": name,
                "before": each.before,
                "after": each.after,
                "difference": views.signed(each.difference),
                "parts": parts,
            }
        )
    return {"judged": len(found.judged), "failed": sorted(found.failed), "changes": rows}


async def _decision(request: Request) -> Callable[[], Decision]:
    body = await request.body()
    return lambda: Decision.model_validate_json(body)


def _json(make: Callable[[], dict[str, Any]]) -> Response:
    """Answer with a result, or with the problem: 409 if another person was quicker, 400 otherwise."""
    try:
        return _answer(json.dumps(make(), default=_number).encode(), ".json")
    except ValidationError as error:
        mistakes = [each["msg"].removeprefix("Value error, ") for each in error.errors()]
        return _refused("this is not a decision", mistakes[:_MOST_MISTAKES])
    except GraderError as error:
        mistakes = []
        if isinstance(error, RubricError):
            mistakes += error.mistakes
        status = 409 if isinstance(error, ChangedSince) else 400
        return _refused(error.problem, mistakes, error.remedy, status)


def _refused(
    problem: str, mistakes: Sequence[str], remedy: str | None = "", status: int = 400
) -> Response:
    reported = {"problem": problem, "mistakes": list(mistakes), "remedy": remedy}
    return _answer(json.dumps(reported).encode(), ".json", status=status)


def _plain(value: Any) -> dict[str, Any]:
    """Return an item or an effect for the page, with displayable texts, and with ids as the page must return them."""
    plain = asdict(value)
    plain["text"] = shown(plain["text"])
    if isinstance(value, Item):
        plain |= {"id": value.id, "kind": value.kind.value}
    return plain


def _number(value: Any) -> Any:
    if isinstance(value, Decimal):
        return views.points(value)
    return list(value)


def _answer(content: bytes, ending: str, policy: str = _OWN_POLICY, status: int = 200) -> Response:
    kind = _TYPES.get(ending, "application/json")
    headers = {**_HEADERS, "Content-Security-Policy": policy}
    return Response(content, status, headers=headers, media_type=kind)


def _not_found() -> Response:
    return Response("There is no such page.", 404, headers=_HEADERS, media_type="text/plain")


def _escaped(error: Exception) -> str:
    from markupsafe import escape

    return str(escape(shown(str(error))))


@lru_cache(maxsize=4)
def _recorded(copy: Path) -> Rubric:
    return recorded_rubric(copy)


class _Guard:
    """Passes on only requests with the token, at the address of the desk."""

    def __init__(
        self, app: Callable[[Scope, Receive, Send], Awaitable[None]], host: str, token: str
    ) -> None:
        self._app = app
        self._host = host
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        refused: Response | None = _not_found()
        if scope["type"] == "http":
            refused = self._refusal(Request(scope))
        await (refused or self._app)(scope, receive, send)

    def _refusal(self, request: Request) -> Response | None:
        given = request.url.path.split("/")[1]
        # A foreign name server can make its name lead here.
        if request.headers.get("host") != self._host:
            return _not_found()
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode()):
            return _not_found()
        if request.method == "GET":
            return None
        if self._is_from_own_page(request) and _is_small_json(request):
            return None
        return Response(
            "Only the desk's own pages may do this.", 403, headers=_HEADERS, media_type="text/plain"
        )

    def _is_from_own_page(self, request: Request) -> bool:
        site = request.headers.get("sec-fetch-site", "same-origin")
        return site == "same-origin" and request.headers.get("origin") == f"http://{self._host}"


def _is_small_json(request: Request) -> bool:
    kind = request.headers.get("content-type", "").partition(";")[0]
    length = request.headers.get("content-length", "")
    is_small = length.isdecimal() and int(length) <= _MOST_BYTES
    return is_small and kind == "application/json"


def serve(desk: Desk, port: int, on_ready: Callable[[str], None]) -> None:
    """Serve a desk to this machine alone until Ctrl-C.

    Parameters
    ----------
    desk
        The desk.
    port
        The port; 0 for a free one.
    on_ready
        Called with the address.

    Raises
    ------
    UsageError
        If the port cannot be used.
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
        # The access log would contain the token.
        settings = uvicorn.Config(
            server.app(host), log_level="error", access_log=False, server_header=False
        )
        # Evidence is made in a fork of this process, and is then ready sooner.
        prepare(desk.rubric)
        desk.settle()
        on_ready(f"http://{host}/{server.token}/")
        uvicorn.Server(settings).run(sockets=[listening])
