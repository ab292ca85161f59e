"""All vehicles on all links, examined at once: bytes and `now` in, bytes and findings out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from swarm_ctl import wire
from swarm_ctl.autopilot.base import AUTOPILOT_COMPONENT, COMPANION_COMPONENT
from swarm_ctl.autopilot.telemetry import is_sensed
from swarm_ctl.doctor.patient import BEAT, HEARTBEAT_S, NO_AUTOPILOT, Patient
from swarm_ctl.mission import Mission
from swarm_ctl.signing import Gatekeeper

Source = tuple[str, int]
GROUND_STATION = 6
"""MAV_TYPE."""
STRANGER = 245
"""sysid of who calls out before he knows whom; 255 would be a ground station's."""
MOST_LINES = 1024
"""Senders listened to; more of them is an attack, not a swarm."""
_HEARTBEAT = wire.message("HEARTBEAT")


@dataclass(frozen=True, slots=True)
class Question:
    """What is to be found out."""

    urls: Sequence[str]
    wanted: frozenset[tuple[str, int]] = frozenset()
    """Whom to examine, by link and sysid; all who are heard when it is empty."""
    mission: Mission | None = None
    is_open_air: bool = False
    speed: float = 1.0
    """Seconds of `now` per second; a simulator's."""
    key: bytes | None = None
    timestamp: int = 0
    """Of signatures, when `now` is 0."""
    patience_s: float = 10.0
    """How long to wait for those who are not heard."""


class Outgoing(NamedTuple):
    """A datagram, and where it goes."""

    url: str
    to: Source | None
    """None: wherever the link leads."""
    data: bytes


class Line:
    """One sender on one link; two vehicles of one sysid on it are told apart by their uids."""

    def __init__(self, url: str, source: Source, question: Question, began_s: float) -> None:
        self.url = url
        self.source = source
        self.patients: dict[int, Patient] = {}
        self.gate = Gatekeeper()
        self._question = question
        if question.key is not None:
            self.gate.take_key(question.key, question.timestamp)
        self._parser = wire.Parser(None)
        self._began_s = began_s
        self._bytes = 0
        self._frames: Counter[int] = Counter()
        self._ground_stations: set[int] = set()
        self._rivals: Counter[int] = Counter()

    @property
    def place(self) -> str:
        """Say which link, and who sends there."""
        host, port = self.source
        return f"{self.url} from {host}:{port}" if self.url.startswith("udpin") else self.url

    def receive(self, data: bytes, now: float) -> None:
        """Take a datagram."""
        self.gate.advance(now)
        self._bytes += len(data)
        for frame in self._parser.feed(data):
            verdict = self.gate.refusal(frame)
            self._frames[frame.sysid] += 1
            if frame.id == _HEARTBEAT.id:
                self._greet(frame, now)
            patient = self.patients.get(frame.sysid)
            if patient is not None and frame.compid == AUTOPILOT_COMPONENT:
                patient.chart.refused += verdict is not None
                patient.receive(frame, now)
            elif patient is not None and is_sensed(frame):
                patient.chart.sense(frame, now)

    def tick(self, now: float) -> Iterator[bytes]:
        """Give what to send now."""
        self.gate.advance(now)
        for sysid, patient in self.patients.items():
            chart = patient.chart
            chart.bytes_s = self._bytes / max(now - self._began_s, 1.0)
            chart.frames, chart.lost = self._frames[sysid], self._parser.lost_of(sysid)
            chart.ground_stations, chart.rivals = self._ground_stations, self._rivals[sysid]
            yield from patient.tick(now)

    def _greet(self, frame: wire.Frame, now: float) -> None:
        """Sort out who says that it is there."""
        sysid, values, wanted = frame.sysid, frame.values, self._question.wanted
        if values.type == GROUND_STATION:
            self._ground_stations.add(sysid)
        elif frame.compid == COMPANION_COMPONENT:
            self._rivals[sysid] += 1
        elif frame.compid == AUTOPILOT_COMPONENT and values.autopilot != NO_AUTOPILOT:
            is_wanted = not wanted or (self.url, sysid) in wanted
            if is_wanted and sysid not in self.patients:
                self.patients[sysid] = Patient(sysid, self.place, self.gate, now)


class Examination:
    """Examine every autopilot that is heard, until nothing is left to be found out."""

    def __init__(self, question: Question, now: float = 0.0) -> None:
        self.question = question
        self.lines: dict[tuple[str, Source], Line] = {}
        self._began_s = now
        self._next_call_s = now
        self._calls = 0
        self._gate = Gatekeeper()
        if question.key is not None:
            self._gate.take_key(question.key, question.timestamp)

    @property
    def patients(self) -> list[Patient]:
        """Who is examined, by sysid."""
        found = [patient for line in self.lines.values() for patient in line.patients.values()]
        return sorted(found, key=lambda patient: (patient.chart.sysid, patient.chart.place))

    @property
    def silent_urls(self) -> list[str]:
        """Links on which no autopilot was heard that is asked for."""
        heard = {url for (url, _), line in self.lines.items() if line.patients}
        return [url for url in self.question.urls if url not in heard]

    @property
    def silent_vehicles(self) -> list[tuple[str, int]]:
        """Those who are asked for and were not heard on their link, where others were."""
        heard = {(url, sysid) for (url, _), line in self.lines.items() for sysid in line.patients}
        silent = self.silent_urls
        return sorted(one for one in self.question.wanted - heard if one[0] not in silent)

    def progress(self, now: float) -> float:
        """Say how much is done, 0 to 1."""
        patients = self.patients
        return sum(patient.progress(now) for patient in patients) / max(len(patients), 1)

    def is_over(self, now: float) -> bool:
        """Whether everybody is examined, or silent for too long."""
        is_patient = now - self._began_s < self.question.patience_s
        if is_patient and (self.silent_urls or self.silent_vehicles):
            return False
        return all(patient.is_examined(now) for patient in self.patients)

    def receive(self, url: str, source: Source, data: bytes, now: float) -> None:
        """Take what came over a link from somebody."""
        line = self.lines.get((url, source))
        if line is None:
            if len(self.lines) >= MOST_LINES:
                return
            line = self.lines[url, source] = Line(url, source, self.question, now)
        line.receive(data, now)

    def tick(self, now: float) -> Iterator[Outgoing]:
        """Give what to send now."""
        if now >= self._next_call_s:
            self._next_call_s = now + HEARTBEAT_S
            self._gate.advance(now)
            for url in self.silent_urls:
                yield Outgoing(url, None, self._call())
        for (url, source), line in self.lines.items():
            for data in line.tick(now):
                yield Outgoing(url, source, data)

    def _call(self) -> bytes:
        """Say that somebody is there: who listens on UDP speaks to nobody else."""
        self._calls += 1
        frame = _HEARTBEAT.pack(self._calls & 0xFF, STRANGER, COMPANION_COMPONENT, *BEAT)
        return self._gate.seal(frame)
