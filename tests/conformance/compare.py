"""Lay the answers of the mock beside the recorded ones, field by field."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rules import rule_of, without_numbers
from transcript import STATES, Said, Script, asked_for

PROMPT_S = 0.5
"""An answer within this time belongs to the request before it, others come by themselves."""
LATE_S = 0.15
"""A prompt answer of the mock comes at most so much later, or earlier, than the recorded one."""
HEARTBEAT_S = 1.2
"""The phase of the heartbeat differs, and shows a change up to a second late."""
DRIFT_S, DRIFT_FRACTION = 1.0, 0.2
"""What comes by itself may differ by so much, plus so much of its time since the last request."""

COUNTED, COUNTED_S = "STAT_", 5.0
"""Told every 30 or 31 s, by luck, which adds up."""

_QUIET = {"HEARTBEAT", "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"}
"""Requests that nobody answers."""


class Difference(NamedTuple):
    """One answer, or field of an answer, in which the mock differs."""

    at_s: float
    kind: str
    """In words, without times, so that equal ones can be counted."""
    request: str
    """After which request, in words."""


@dataclass
class Comparison:
    """What became of one suite."""

    suite: str
    requests: int
    answers: int
    equal: int
    differences: list[Difference] = field(default_factory=list)


class _Asked(NamedTuple):
    """An answer with the request that it follows."""

    said: Said
    request: Said | None

    @property
    def delay_s(self) -> float:
        return self.said.at_s - (self.request.at_s if self.request else 0.0)

    @property
    def is_answer(self) -> bool:
        """Whether it came by the request."""
        is_about = self.request is not None and _is_about(self.request, self.said)
        return is_about and self.delay_s <= PROMPT_S

    @property
    def is_prompt(self) -> bool:
        """Whether it came soon after a request, perhaps by it."""
        if self.said.name == "PARAM_VALUE":
            return self.is_answer
        return self.request is not None and self.delay_s <= PROMPT_S

    @property
    def slack_s(self) -> float:
        """Give the time by which the mock may be off."""
        slack_s = LATE_S if self.is_prompt else DRIFT_S + DRIFT_FRACTION * self.delay_s
        if str(self.said.fields.get("param_id")).startswith(COUNTED):
            return max(slack_s, COUNTED_S)
        return max(slack_s, HEARTBEAT_S) if self.said.name in STATES else slack_s


def compare(script: Script, answers: Sequence[Said]) -> Comparison:
    """Compare the answers of the mock with those of the script."""
    if script.heard:
        answers = [said for said in answers if _Asked(said, asker(script, said)).is_answer]
    recorded = [_Asked(said, asker(script, said)) for said in script.answers]
    differences: list[Difference] = []
    partners: dict[int, int] = {}
    equal = 0
    ours, theirs = _by_channel(answers), _by_channel(script.answers)
    for channel in sorted({*ours, *theirs}):
        pairs, missing, extra = _align(
            [(i, recorded[i]) for i in theirs[channel]], [(j, answers[j]) for j in ours[channel]]
        )
        partners.update(pairs)
        for i, j in pairs:
            found = list(_fields(recorded[i], answers[j], channel))
            differences += found
            equal += not found
        differences += _unpaired(script, recorded, answers, missing, extra, channel)
    differences += _disorder(recorded, partners)
    differences.sort()
    asked = sum(request.name not in _QUIET for request in script.requests)
    return Comparison(script.name, asked, len(recorded), equal, differences)


def asker(script: Script, said: Said) -> Said | None:
    """Find the request that an answer follows: one of its own kind just before it, or the last."""
    before = [r for r in script.requests if r.name not in _QUIET and r.at_s <= said.at_s]
    recent = (r for r in reversed(before) if said.at_s - r.at_s <= PROMPT_S)
    return next((r for r in recent if _is_about(r, said)), before[-1] if before else None)


def _is_about(request: Said, said: Said) -> bool:
    if said.name == "COMMAND_ACK":
        named = request.fields.get("command", 0) == said.fields.get("command", 0)
        return request.name == "SET_MODE" or (request.name.startswith("COMMAND") and named)
    if said.name == "PARAM_VALUE":
        by_index = "param_index" in request.fields and request.fields["param_index"] >= 0
        return by_index or request.fields.get("param_id") == said.fields.get("param_id")
    if request.name.startswith("COMMAND"):
        return said.name in asked_for(request)
    return request.name.partition("_")[0] == said.name.partition("_")[0]


def channel_of(said: Said) -> str:
    """Name the sequence of answers that an answer stands in."""
    fields = said.fields
    if said.name == "COMMAND_ACK":
        return f"COMMAND_ACK {fields.get('command', 0)}"
    if said.name == "COMMAND_LONG":
        return f"COMMAND_LONG {fields.get('command', 0)}"
    if said.name == "PARAM_VALUE":
        return f"PARAM_VALUE {fields.get('param_id', '')}"
    if said.name == "STATUSTEXT":
        return f'STATUSTEXT "{without_numbers(fields.get("text", ""))}"'
    if fields.get("mission_type"):
        return f"{said.name} of type {fields['mission_type']}"
    return said.name


def in_words(request: Said | None) -> str:
    """Name a request."""
    if request is None:
        return "boot"
    fields = request.fields
    if request.name.startswith("COMMAND"):
        names = [*(f"param{k}" for k in range(1, 8)), "x", "y", "z"]
        params = [fields.get(name, 0) for name in names if name in fields or name < "param5"]
        while params and not params[-1]:
            params.pop()
        return f"{request.name} {fields.get('command', 0)}({', '.join(f'{p:g}' for p in params)})"
    return " ".join([request.name, str(fields.get("param_id", ""))]).strip()


def _by_channel(answers: Iterable[Said]) -> defaultdict[str, list[int]]:
    channels: defaultdict[str, list[int]] = defaultdict(list)
    for index, said in enumerate(answers):
        channels[channel_of(said)].append(index)
    return channels


def _align(
    recorded: Sequence[tuple[int, _Asked]], mocked: Sequence[tuple[int, Said]]
) -> tuple[list[tuple[int, int]], list[int], list[int]]:
    """Pair two sequences in order: as many equal pairs as can be, then as many pairs at all."""
    rows, columns = len(recorded), len(mocked)
    best = [[0] * (columns + 1) for _ in range(rows + 1)]
    for r in range(rows - 1, -1, -1):
        for c in range(columns - 1, -1, -1):
            gain = _gain(recorded[r][1], mocked[c][1])
            paired = best[r + 1][c + 1] + gain if gain else 0
            best[r][c] = max(paired, best[r + 1][c], best[r][c + 1])
    pairs, r, c = [], 0, 0
    while r < rows and c < columns:
        gain = _gain(recorded[r][1], mocked[c][1])
        if gain and best[r][c] == best[r + 1][c + 1] + gain:
            pairs.append((recorded[r][0], mocked[c][0]))
            r, c = r + 1, c + 1
        elif best[r][c] == best[r + 1][c]:
            r += 1
        else:
            c += 1
    missing = sorted({i for i, _ in recorded} - {i for i, _ in pairs})
    extra = sorted({j for j, _ in mocked} - {j for _, j in pairs})
    return pairs, missing, extra


def _gain(recorded: _Asked, mocked: Said) -> int:
    if abs(recorded.said.at_s - mocked.at_s) > recorded.slack_s:
        return 0
    return 3 if not list(differing(recorded.said, mocked)) else 1


def differing(recorded: Said, mocked: Said) -> Iterable[str]:
    """Name the fields in which two messages differ by more than their rules allow."""
    for name in {**recorded.fields, **mocked.fields}:
        theirs, ours = recorded.fields.get(name, 0), mocked.fields.get(name, 0)
        if not rule_of(recorded.name, recorded.fields, name).agree(theirs, ours):
            yield name


def _fields(recorded: _Asked, mocked: Said, channel: str) -> Iterable[Difference]:
    for name in differing(recorded.said, mocked):
        theirs, ours = recorded.said.fields.get(name, 0), mocked.fields.get(name, 0)
        words = f"recorded {_value(channel, name, theirs)}, mock {_value(channel, name, ours)}"
        kind = f"{channel}, {name}: {words}"
        yield Difference(recorded.said.at_s, kind, in_words(recorded.request))


def _value(channel: str, name: str, value: Any) -> str:
    if channel.startswith("COMMAND_ACK") and name == "result":
        return str(mavlink.enums["MAV_RESULT"][value].name).removeprefix("MAV_RESULT_")
    if channel.startswith("MISSION_ACK") and name == "type":
        return str(mavlink.enums["MAV_MISSION_RESULT"][value].name).removeprefix("MAV_MISSION_")
    return f"{value:g}" if isinstance(value, float) else str(value)


def _unpaired(
    script: Script,
    recorded: Sequence[_Asked],
    answers: Sequence[Said],
    missing: Sequence[int],
    extra: Sequence[int],
    channel: str,
) -> Iterable[Difference]:
    """Tell who stays alone; a missing and an extra one that are equal came at another time."""
    fleeting = _fleeting(script.answers, missing), _fleeting(answers, extra)
    alone = [j for j in extra if j not in fleeting[1]]
    for i in missing:
        if i in fleeting[0]:
            continue
        told = recorded[i].said
        twin = next((j for j in alone if not list(differing(told, answers[j]))), None)
        kind = f"{channel}{_content(told)} missing"
        if twin is not None:
            alone.remove(twin)
            when = "later" if answers[twin].at_s > told.at_s else "earlier"
            kind = f"{channel}{_content(told)} {when} than recorded"
        yield Difference(told.at_s, kind, in_words(recorded[i].request))
    for j in alone:
        request = in_words(asker(script, answers[j]))
        yield Difference(answers[j].at_s, f"{channel}{_content(answers[j])} not recorded", request)


def _fleeting(answers: Sequence[Said], alone: Iterable[int]) -> set[int]:
    """Find the messages of states that ended before the next one was due: it was luck."""
    lives_s: dict[int, float] = {}
    for name in ("HEARTBEAT", "MISSION_CURRENT"):
        told = [i for i, said in enumerate(answers) if said.name == name]
        lives_s |= {i: answers[j].at_s - answers[i].at_s for i, j in pairwise(told)}
    return {i for i in alone if lives_s.get(i, HEARTBEAT_S) < HEARTBEAT_S}


def _content(said: Said) -> str:
    """Say of a message what matters in it."""
    telling: Mapping[str, tuple[str, ...]] = {
        **STATES,
        "COMMAND_ACK": ("result",),
        "MISSION_ACK": ("type",),
    }
    names = telling.get(said.name, ())
    values = [_value(said.name, name, said.fields.get(name, 0)) for name in names]
    return f" ({', '.join(values)})" if values else ""


def _disorder(recorded: Sequence[_Asked], partners: Mapping[int, int]) -> Iterable[Difference]:
    """Find requests whose prompt answers came in another order."""
    groups: defaultdict[int, list[int]] = defaultdict(list)
    for i, answer in enumerate(recorded):
        if answer.is_prompt and answer.said.name not in STATES and i in partners:
            groups[id(answer.request)].append(i)
    for group in groups.values():
        order = [partners[i] for i in group]
        if order != sorted(order):
            told = recorded[group[0]]
            names = ", ".join(dict.fromkeys(channel_of(recorded[i].said) for i in group))
            yield Difference(told.said.at_s, f"other order than {names}", in_words(told.request))
