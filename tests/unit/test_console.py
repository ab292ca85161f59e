"""The console without a browser: its picture, its door, its replays' clock."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.cli_console import console
from swarm_ctl.console import server
from swarm_ctl.console.door import App, Door, Receive, Scope, Send
from swarm_ctl.console.picture import LOG_LINES, TRAIL_POINTS, Cursor, Grid, Line, Picture, Victim
from swarm_ctl.console.replay import Replay
from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Vec3

TRAIL = 9
"""Place of the trail in a vehicle's row."""


@pytest.fixture
def picture() -> Picture:
    return Picture({"mission": "search"}, Grid(0.25))


# -- the picture -----------------------------------------------------------------------------------


def test_a_browser_gets_everything_once_and_then_what_is_new(picture: Picture) -> None:
    cursor = Cursor()
    picture.see([(1, 2), (3, 4)])
    picture.tell(Line(1.0, 1, "Connected", "connected, px4"))
    first = picture.frame(cursor)
    assert (first["reset"], first["head"]["mission"]) == (True, "search")
    assert first["cells"] == [1, 2, 3, 4]
    assert first["log"] == [[1.0, 1, "Connected", "connected, px4"]]

    picture.see([(3, 4), (5, 6)])
    second = picture.frame(cursor)
    assert not {"reset", "head"} & set(second)
    assert (second["cells"], second["log"]) == ([5, 6], [])


def test_a_trail_is_told_point_by_point(picture: Picture) -> None:
    cursor, vehicle = Cursor(), picture.vehicle(7)
    vehicle.move(Vec3(1.0, 2.0, -3.0), 0.5)
    assert picture.frame(cursor)["vehicles"][0][TRAIL] == [[1.0, 2.0, -3.0]]
    vehicle.move(Vec3(1.5, 2.0, -3.0), 0.5)
    assert picture.frame(cursor)["vehicles"][0][TRAIL] == [[1.5, 2.0, -3.0]]
    assert picture.frame(cursor)["vehicles"][0][TRAIL] == []


def test_a_browser_that_slept_gets_what_is_kept_and_no_more(picture: Picture) -> None:
    cursor, vehicle = Cursor(), picture.vehicle(1)
    picture.frame(cursor)
    for step in range(3 * TRAIL_POINTS):
        vehicle.move(Vec3(float(step), 0.0, 0.0), 0.0)
    for number in range(3 * LOG_LINES):
        picture.tell(Line(float(number), 1, "StatusText", str(number)))
    frame = picture.frame(cursor)
    assert len(frame["vehicles"][0][TRAIL]) == TRAIL_POINTS
    assert frame["vehicles"][0][TRAIL][-1] == [3.0 * TRAIL_POINTS - 1.0, 0.0, 0.0]
    assert (len(frame["log"]), frame["log"][-1][3]) == (LOG_LINES, str(3 * LOG_LINES - 1))


def test_who_found_a_victim_first_stands_and_a_missing_place_comes_later(picture: Picture) -> None:
    picture.find(Victim(4, None, 2, 10.0))
    picture.find(Victim(4, Vec3(1.0, 1.0, 0.0), 3, 12.0))
    assert picture.victims[4] == Victim(4, Vec3(1.0, 1.0, 0.0), 2, 10.0)


def test_a_frame_of_a_hundred_vehicles_is_small(picture: Picture) -> None:
    cursor = Cursor()
    for sysid in range(1, 101):
        picture.vehicle(sysid).move(Vec3(12.345, 23.456, -1.5), 1.234)
        picture.vehicle(sysid).peers = (1, 2, 3, 4, 5)
        picture.vehicle(sysid).note = "found victim 3"
    picture.frame(cursor)
    for sysid in range(1, 101):
        picture.vehicle(sysid).move(Vec3(12.845, 23.456, -1.5), 1.234)
    assert len(json.dumps(picture.frame(cursor))) < 15_000


# -- the door --------------------------------------------------------------------------------------


def knock(kind: str = "http", query: str = "", **headers: str) -> list[Any]:
    """Ask at a door with the token `secret` and give what was answered."""
    answers: list[Any] = []

    async def inside(_scope: Scope, _receive: Receive, _send: Send) -> None:
        answers.append("entered")

    async def send(message: Any) -> None:
        answers.append(message)

    async def receive() -> Any:
        return {}

    told = [(name.encode(), value.encode()) for name, value in headers.items()]
    scope = {"type": kind, "query_string": query.encode(), "headers": told}
    app: App = inside
    asyncio.run(Door(app, "secret", 8080)(scope, receive, send))
    return answers


def test_without_the_token_nobody_enters() -> None:
    assert knock()[0]["status"] == 403
    assert knock(query="token=wrong")[0]["status"] == 403
    assert knock(cookie="swarm_console_8080=wrong")[0]["status"] == 403
    assert knock(cookie="swarm_console_8080=geheim;;;=")[0]["status"] == 403
    assert knock("websocket") == [{"type": "websocket.close", "code": 1008}]


def test_the_token_in_the_address_becomes_a_cookie_that_opens() -> None:
    [start, _] = knock(query="token=secret")
    cookie = dict(start["headers"])[b"set-cookie"].decode()
    assert start["status"] == 303
    assert {"HttpOnly", "SameSite=Strict"} <= set(cookie.split("; "))
    assert knock(cookie=cookie.split(";")[0]) == ["entered"]


def test_a_socket_from_another_page_is_refused_even_with_the_cookie() -> None:
    cookie, host = "swarm_console_8080=secret", "127.0.0.1:8080"
    assert knock("websocket", cookie=cookie, host=host, origin=f"http://{host}") == ["entered"]
    stranger = knock("websocket", cookie=cookie, host=host, origin="http://127.0.0.1:9999")
    assert stranger == [{"type": "websocket.close", "code": 1008}]


# -- mistakes --------------------------------------------------------------------------------------


def test_a_port_that_is_taken_is_one_sentence() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(SwarmError, match=rf"--port {port}: .*choose another --port"):
            server.listen("127.0.0.1", port)


def test_a_folder_that_is_no_run_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SwarmError, match="is no run folder"):
        Replay.read(tmp_path)


def test_without_the_extra_the_console_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delattr("swarm_ctl.console.server")
    monkeypatch.delitem(sys.modules, "swarm_ctl.console.server")
    monkeypatch.setitem(sys.modules, "nicegui", None)
    with pytest.raises(SwarmError, match=r"pip install 'swarm-ctl\[console\]'"):
        console(tmp_path)


def test_a_mission_that_would_be_several_topics_is_one_sentence() -> None:
    with pytest.raises(SwarmError, match="--mission a/#: expected the name of a mission"):
        console(mission="a/#", port=0)
