"""Official OpenAPI files as judges of what our clients and the mock network say to each other."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import yaml

from simple_ros_engines.network_exposure.exposure.http import (
    HttpRequest,
    HttpResponse,
    HttpTransport,
    StandardTransport,
)

DIRECTORY = os.environ.get("SIMPLE_ROS_OPENAPI_DIR", "")
HAS_FILES = bool(DIRECTORY) and Path(DIRECTORY, "camara").is_dir()
needs_openapi = pytest.mark.skipif(
    not HAS_FILES,
    reason="SIMPLE_ROS_OPENAPI_DIR does not name a folder with the official files",
)
FILES = {
    "/ss-gm/v1": "https://judge/3gpp/TS29549_SS_GroupManagement.yaml",
    "/ss-nra/v1": "https://judge/3gpp/TS29549_SS_NetworkResourceAdaptation.yaml",
    "/ss-nrm/v1": "https://judge/3gpp/TS29549_SS_NetworkResourceMonitoring.yaml",
    "/3gpp-as-session-with-qos/v1": "https://judge/3gpp/TS29122_AsSessionWithQoS.yaml",
    "/quality-on-demand/v1": "https://judge/camara/quality-on-demand.yaml",
}


@dataclass
class Exchange:
    request: HttpRequest
    response: HttpResponse
    is_spoilt: bool = False


@dataclass
class Recorder(HttpTransport):
    """Sends as the real one, and remembers.

    Attributes:
        is_spoiling: Whether what is answered now is wrong on purpose.
    """

    inner: HttpTransport = field(default_factory=StandardTransport)
    exchanges: list[Exchange] = field(default_factory=list)
    is_spoiling: Callable[[], bool] = lambda: False

    async def send(self, request: HttpRequest, timeout_s: float) -> HttpResponse:
        is_spoilt = self.is_spoiling()
        response = await self.inner.send(request, timeout_s)
        self.exchanges.append(Exchange(request, response, is_spoilt))
        return response

    def complaints(self) -> list[str]:
        """What the official files say against all that was sent and answered; nothing without the files."""
        if not HAS_FILES:
            return []
        return [
            f"{one.request.method} {one.request.url} -> {one.response.status}: {text}"
            for one in self.exchanges
            if not one.is_spoilt and any(root in one.request.url for root in FILES)
            for text in judge(one)
        ]


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """YAML whose dates stay text."""


_Loader.yaml_implicit_resolvers = {
    letter: [(tag, pattern) for tag, pattern in found if tag != "tag:yaml.org,2002:timestamp"]
    for letter, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


@cache
def document(uri: str) -> Any:
    folder = "camara" if "/3gpp/" not in uri else "3gpp-Rel-18"
    path = Path(DIRECTORY, folder, uri.rpartition("/")[2])
    return yaml.load(path.read_text("utf-8").replace("\t", "    "), Loader=_Loader)


@cache
def registry() -> Any:
    from referencing import Registry, Resource
    from referencing.jsonschema import DRAFT4

    return Registry(retrieve=lambda uri: Resource(document(uri), DRAFT4))


def _pointer(*words: str) -> str:
    return "/".join(word.replace("~", "~0").replace("/", "~1") for word in words)


def problems_of(value: Any, uri: str, *words: str) -> list[str]:
    """What is wrong with a value, by the schema at a place in a file."""
    from jsonschema import Draft4Validator

    validator = Draft4Validator({"$ref": f"{uri}#/{_pointer(*words)}"}, registry=registry())
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(value)]


def _operation(exchange: Exchange) -> tuple[str, list[str], Any]:
    path, method = urlsplit(exchange.request.url).path, exchange.request.method.lower()
    root = next(root for root in FILES if path.startswith(root))
    uri = FILES[root]
    for template, operations in document(uri)["paths"].items():
        pattern = re.sub(r"\{[^}]+\}", "[^/]+", template)
        if re.fullmatch(pattern, path.removeprefix(root)) and method in operations:
            return uri, ["paths", template, method], operations[method]
    raise AssertionError(f"the standard has no {method} {path}")


def _resolved(uri: str, words: list[str], node: Any) -> tuple[str, list[str], Any]:
    while "$ref" in node:
        resolver = registry().resolver(uri)
        found = resolver.lookup(node["$ref"])
        target, _, fragment = node["$ref"].partition("#/")
        uri = uri if not target else str(found.resolver._base_uri)
        words = fragment.split("/")
        node = found.contents
    return uri, words, node


def _body_problems(data: bytes, uri: str, words: list[str], node: Any, content: str) -> list[str]:
    uri, words, node = _resolved(uri, words, node)
    schemas = node.get("content", {})
    if not data:
        return []
    kind = content.partition(";")[0]
    if kind not in schemas:
        return [f"{kind} is none of {', '.join(schemas)}"]
    return problems_of(json.loads(data), uri, *words, "content", kind, "schema")


def judge(exchange: Exchange) -> list[str]:
    """What is wrong with a request and its answer."""
    uri, words, operation = _operation(exchange)
    request, response = exchange.request, exchange.response
    found = []
    if request.body:
        where = [*words, "requestBody"]
        content = request.headers["Content-Type"]
        found += _body_problems(request.body, uri, where, operation["requestBody"], content)
    status = str(response.status)
    if status not in operation["responses"] and response.status >= 500:
        # A server that fails follows no file.
        return found
    if status not in operation["responses"]:
        return [*found, f"{status} is no answer of {operation.get('operationId')}"]
    node = operation["responses"][status]
    where = [*words, "responses", status]
    if response.body:
        content = response.headers["content-type"]
        found += _body_problems(response.body, uri, where, node, content)
    _, _, node = _resolved(uri, where, node)
    required = [name for name, head in node.get("headers", {}).items() if head.get("required")]
    found += [f"no {name}" for name in required if name.lower() not in response.headers]
    return found
