"""The parameter microservice: lists, single values, changes; as each autopilot was recorded.

https://mavlink.io/en/services/parameter.html
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.link import Link
from mock_vehicle.autopilot.parameter_files import INT32
from mock_vehicle.autopilot.parameters import Parameters, encode_bytewise
from mock_vehicle.autopilot.traits import Severity
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

PARAM_REQUEST_LIST = wire.message("PARAM_REQUEST_LIST")
PARAM_REQUEST_READ = wire.message("PARAM_REQUEST_READ")
PARAM_SET = wire.message("PARAM_SET")
PARAM_VALUE = wire.message("PARAM_VALUE")

UINT32 = 5
NO_INDEX = 0xFFFF
BY_NAME = -1
"""param_index of a PARAM_REQUEST_READ that means its name."""
HASH = "_HASH_CHECK"


class ParameterService:
    """Tells and changes the parameters of one vehicle over its links."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._dialect = parameters.dialect
        self._lists: dict[Link, tuple[float, int]] = {}
        """Lists under way: when they began, and how many values have gone."""
        self._repeats: list[tuple[float, str]] = []
        """Changes that all links are still to hear of, and when."""
        self._boot_news = list(self._dialect.boot_news)[::-1]

    def run(self, autopilot: Autopilot, now: float) -> None:
        """Go on with lists, and repeat changes that are due."""
        for link in (*self._lists,):
            with autopilot.serving(link):
                self._continue(autopilot, link, now)
        while self._repeats and self._repeats[0][0] <= now:
            self.tell(autopilot, self._repeats.pop(0)[1])
        if self._boot_news and autopilot.is_talkative:
            self._tell_boot_news(autopilot, autopilot.recorded_s(now))

    def _tell_boot_news(self, autopilot: Autopilot, recorded_s: float) -> None:
        while self._boot_news and self._boot_news[-1][0] <= recorded_s:
            for news in self._boot_news.pop()[1].split():
                name, _, value = news.partition("=")
                if value:
                    self._parameters[name] = float(value)
                self.tell(autopilot, name)

    def _continue(self, autopilot: Autopilot, link: Link, now: float) -> None:
        began, told = self._lists[link]
        due = int((now - began - self._dialect.list_after_s) * self._dialect.list_per_s)
        for index in range(told, min(due, len(self._parameters))):
            name = self._parameters.named(index) or ""
            self._send(autopilot, name, name, index)
            told += 1
        self._lists[link] = began, told
        if told == len(self._parameters):
            del self._lists[link]

    def begin_list(self, autopilot: Autopilot, now: float) -> None:
        """Start the list, again from the first where it is under way."""
        for text in autopilot.banner:
            autopilot.say(Severity.INFO, text, now)
        if self._dialect.has_hash:
            self._send_hash(autopilot)
        for link in autopilot.to:
            self._lists[link] = now, 0

    def _end_list(self, autopilot: Autopilot) -> None:
        """Stop the list: who asked knows its parameters by their checksum."""
        for link in autopilot.to:
            self._lists.pop(link, None)

    def tell(self, autopilot: Autopilot, name: str, spelt: str | None = None) -> None:
        """Send the value of a parameter, under its name as it was spelt, unless it is unknown."""
        if self._dialect.has_hash and name == HASH:
            self._send_hash(autopilot)
        elif name in self._parameters:
            index = self._parameters.index(name) if self._dialect.tells_index else NO_INDEX
            self._send(autopilot, name, spelt or name, index)

    def tell_indexed(self, autopilot: Autopilot, index: int) -> None:
        """Send the value of a parameter by its place in the list, unless it is beyond."""
        name = self._parameters.named(index)
        if name is not None:
            self._send(autopilot, name, name, index)

    def change(self, autopilot: Autopilot, spelt: str, raw: float, kind: int, now: float) -> None:
        """Take a value from the wire, and tell which one is in force; nothing for nonsense."""
        name = self.known(spelt)
        if self._dialect.has_hash and name == HASH:
            self._end_list(autopilot)
        if name not in self._parameters:
            return
        value = self._dialect.decode(raw, kind, self._parameters.kind(name))
        if value is None:
            return
        changes = value != self._parameters[name]
        autopilot.set_parameter(name, value)
        if self._dialect.repeat_after_s is None:
            with autopilot.serving(*autopilot.links):
                self.tell(autopilot, name, spelt)
            return
        self.tell(autopilot, name)
        if changes:
            self._repeats.append((now + self._dialect.repeat_after_s, name))

    def known(self, spelt: str) -> str:
        """Give the name as the table has it."""
        return spelt.upper() if self._dialect.ignores_case else spelt

    def _send(self, autopilot: Autopilot, name: str, spelt: str, index: int) -> None:
        kind = self._parameters.kind(name)
        value = self._dialect.encode(self._parameters[name], kind)
        autopilot.send(PARAM_VALUE, spelt, value, kind, len(self._parameters), index)

    def _send_hash(self, autopilot: Autopilot) -> None:
        value = encode_bytewise(self._parameters.checksum, INT32)
        autopilot.send(PARAM_VALUE, HASH, value, UINT32, len(self._parameters), NO_INDEX)


def on_request_list(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Start to send all parameters, a few per step."""
    v = frame.values
    if autopilot.accepts_command(v.target_system, v.target_component, 0):
        autopilot.parameter_service.begin_list(autopilot, now)


def on_request_read(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:  # noqa: ARG001
    """Send one parameter, by index or by name."""
    v, service = frame.values, autopilot.parameter_service
    if not autopilot.accepts_command(v.target_system, v.target_component, 0):
        return
    if v.param_index == BY_NAME:
        service.tell(autopilot, service.known(v.param_id), v.param_id)
    else:
        service.tell_indexed(autopilot, v.param_index)


def on_set(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Change one parameter."""
    v, service = frame.values, autopilot.parameter_service
    if autopilot.accepts_command(v.target_system, v.target_component, 0):
        service.change(autopilot, v.param_id, v.param_value, v.param_type, now)


MESSAGES: Mapping[int, Callable[..., None]] = {
    PARAM_REQUEST_LIST.id: on_request_list,
    PARAM_REQUEST_READ.id: on_request_read,
    PARAM_SET.id: on_set,
}
"""The parameter microservice, by message id."""
