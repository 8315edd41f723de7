"""The one exception of this package."""

from __future__ import annotations

import json
from typing import Any, List, Mapping, Optional

from .models import ErrorLocation

__all__ = ["PinstackError"]


class PinstackError(Exception):
    """A request was refused, a job failed, or the service cannot be reached. Its text is the sentence of the service.

    Attributes:
        code: stable code of the service, or one
            of this package: ``unreachable``, ``unexpected_response``, ``timeout``, ``cancelled``, ``invalid_source``,
            ``source_changed``.
        detail: what is wrong, where, and what to do.
        errors: single places that are wrong: file, slice or parameter.
        status: HTTP status; 0 when there was no response.
        problem: the whole problem document.
        request_id: the request in the log of the service, if known.
    """

    def __init__(
        self, code: str, detail: str, *, problem: Optional[Mapping[str, Any]] = None, request_id: Optional[str] = None
    ) -> None:
        super().__init__(detail)
        self.problem: Mapping[str, Any] = problem if problem is not None else {"code": code, "detail": detail}
        self.code = code
        self.detail = detail
        self.request_id = request_id

    def __reduce__(self) -> Any:
        return (_restore, (self.code, self.detail, dict(self.problem), self.request_id))

    @property
    def status(self) -> int:
        """HTTP status; 0 when there was no response."""
        status = self.problem.get("status", 0)
        return status if isinstance(status, int) else 0

    @property
    def errors(self) -> List[ErrorLocation]:
        """Single places that are wrong."""
        errors = self.problem.get("errors")
        return list(errors) if isinstance(errors, list) else []

    @classmethod
    def of_problem(cls, problem: Mapping[str, Any], request_id: Optional[str] = None) -> PinstackError:
        """The error that a problem document describes."""
        code = str(problem.get("code", "unexpected_response"))
        detail = str(problem.get("detail") or problem.get("title") or code)
        return cls(code, detail, problem=problem, request_id=request_id)

    @classmethod
    def of_response(cls, status: int, body: bytes, request_id: Optional[str], what: str) -> PinstackError:
        """The error of a response; ``what`` names the request."""
        try:
            problem = json.loads(body)
        except ValueError:
            problem = None
        if isinstance(problem, dict) and "code" in problem:
            return cls.of_problem(problem, request_id)
        start = " ".join(body[:200].decode("utf-8", "replace").split())
        detail = f"{what} was answered with status {status}, and not by pinstack"
        detail += f": {start}" if start else "; is there a proxy in between?"
        problem = {"code": "unexpected_response", "status": status, "detail": detail}
        return cls("unexpected_response", detail, problem=problem, request_id=request_id)


def _restore(code: str, detail: str, problem: Mapping[str, Any], request_id: Optional[str]) -> PinstackError:
    return PinstackError(code, detail, problem=problem, request_id=request_id)
