"""Clients of `semmap serve`: some are refused, and some go away before their answer comes."""

from __future__ import annotations

import socket
import threading
from collections import Counter
from collections.abc import Callable
from random import Random

import httpx

TOKEN = "a robot's growing token".replace(" ", "-")
EVERY = 0.05
"""Seconds between two requests."""

ASK = "ASK { ?x a semmap:Desk }"
JOIN = "SELECT ?x ?r { ?x semmap:placedOn ?d . ?d semmap:heldBy ?r . ?r semmap:kind 'room' }"
STATE = "INSERT DATA {{ GRAPH <urn:g{0}> {{ :{1} <urn:p{0}> '{0}' }} }}"
TAKE_BACK = "DELETE WHERE { GRAPH ?g { ?s ?p ?o } }"


class Requests(threading.Thread):
    """Sends requests to the map at an address within a context, with the rights of a robot.

    `answers` counts them; `wrong` has those that are answered by another status.
    """

    def __init__(self, address: str, entity: str, at: tuple[float, ...]) -> None:
        super().__init__(daemon=True)
        self._url, self._entity, self._at = httpx.URL(f"{address}/maps/growth/"), entity, at
        self._end = threading.Event()
        self.answers: Counter[int] = Counter()
        self.wrong: list[str] = []

    def __enter__(self) -> Requests:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self.join()

    def run(self) -> None:
        """Send the requests in turn."""
        rights = {"Authorization": f"Bearer {TOKEN}"}
        draw, number = Random(2), 0
        # A connection for each: the server may close one that is kept while a request is under way.
        alone = httpx.Limits(max_keepalive_connections=0)
        with httpx.Client(base_url=self._url, timeout=60, limits=alone) as http:

            def move(**options: dict[str, str]) -> httpx.Response:
                x, y, z = self._at
                to = {"entity": self._entity, "x": x + draw.uniform(-0.02, 0.02), "y": y, "z": z}
                return http.post("move_to", json=to, **options)

            def update(text: str) -> httpx.Response:
                return http.post("rdf/update", data={"update": text}, headers=rights)

            turns: list[tuple[int, Callable[[], httpx.Response]]] = [
                (200, lambda: move(headers=rights)),
                (200, lambda: http.get("rdf/sparql", params={"query": ASK})),
                (200, lambda: http.get("rdf/sparql", params={"query": JOIN})),
                (200, lambda: http.get("costs")),
                (401, move),
                (400, lambda: http.get("rdf/sparql", params={"query": f"ASK {{ {number}"})),
                (200, lambda: update(STATE.format(number, self._entity))),
                (200, lambda: update(TAKE_BACK)),
            ]
            while not self._end.wait(EVERY):
                number += 1
                expected, send = turns[number % len(turns)]
                try:
                    answer = send()
                except httpx.HTTPError as error:
                    self.wrong.append(f"request {number}: {error!r}")
                    continue
                self.answers[answer.status_code] += 1
                if answer.status_code != expected:
                    self.wrong.append(f"{answer.url}: {answer.status_code}: {answer.text[:200]}")
                if number % len(turns) == 0:
                    self._leave("draw" if number % (10 * len(turns)) == 0 else "costs")

    def _leave(self, path: str) -> None:
        """Go away, once before a request is whole, and once before its answer."""
        request = f"GET {self._url.path}{path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
        for sent in (request[:20], request):
            with socket.create_connection((self._url.host, self._url.port or 80)) as gone:
                gone.sendall(sent)
