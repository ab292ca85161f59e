"""What peers lack, found by what has changed, against looking at everybody and everything."""

import math
import tracemalloc
from dataclasses import dataclass, field

from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore.contacts import CONTACT_S, RESEND_S, Contacts, Lack


@dataclass
class PlainPeer:
    origin: int | None = None
    heard_s: float = -math.inf
    known: dict[int, int] = field(default_factory=dict)
    sent: dict[int, tuple[int, float]] = field(default_factory=dict)

    def has(self, origin: int, now: float) -> int:
        length, sent_s = self.sent.get(origin, (0, -math.inf))
        return max(self.known.get(origin, 0), length if now - sent_s < RESEND_S else 0)


class Plain:
    """The same, forgetting nothing and caching nothing."""

    def __init__(self) -> None:
        self.peers: dict[int, PlainPeer] = {}
        self.lengths: dict[int, int] = {}

    def near(self, now: float) -> list[PlainPeer]:
        peers = self.peers.values()
        return [p for p in peers if p.origin is not None and now - p.heard_s <= CONTACT_S]

    def lacks(self, now: float) -> list[Lack]:
        found = []
        for origin, length in self.lengths.items():
            begin = min((peer.has(origin, now) for peer in self.near(now)), default=length)
            if begin < length:
                found.append(Lack(begin - length, origin, begin))
        return sorted(found)


SYSIDS = st.integers(1, 4)
ORIGINS = st.integers(1, 5)
LENGTHS = st.integers(0, 9)
EVENTS = st.one_of(
    st.tuples(st.just("wait"), st.sampled_from([0.1, 0.3, RESEND_S, 1.0, CONTACT_S]), st.none()),
    st.tuples(st.just("meet"), SYSIDS, st.none()),
    st.tuples(st.just("offer"), ORIGINS, LENGTHS),
    st.tuples(
        st.just("summary"),
        SYSIDS,
        st.lists(st.tuples(ORIGINS, LENGTHS), min_size=1, max_size=4),
    ),
    st.tuples(st.just("piece"), SYSIDS, st.tuples(ORIGINS, LENGTHS)),
    st.tuples(st.just("send"), st.integers(1, 3), st.integers(1, 4)),
)


class Both:
    """Tell both of the same events."""

    def __init__(self) -> None:
        self.now = 0.0
        self.quick, self.plain = Contacts(), Plain()

    def wait(self, seconds: float, _: None) -> None:
        self.now += seconds

    def meet(self, sysid: int, _: None) -> None:
        self.quick.meet(sysid, self.now, (0.0, 0.0))
        self.plain.peers.setdefault(sysid, PlainPeer()).heard_s = self.now

    def offer(self, origin: int, length: int) -> None:
        self.quick.offer(origin, length)
        self.plain.lengths[origin] = length

    def summary(self, sysid: int, pairs: list[tuple[int, int]]) -> None:
        self.quick.hear_summary(sysid, pairs)
        peer = self.plain.peers.setdefault(sysid, PlainPeer())
        if peer.origin not in {None, pairs[0][0]}:
            peer.known, peer.sent = {}, {}
        peer.origin = pairs[0][0]
        peer.known.update(pairs)

    def piece(self, sysid: int, piece: tuple[int, int]) -> None:
        heard = self.quick.get(sysid)
        if heard is not None:
            self.quick.hear_piece(heard, *piece)
            known = self.plain.peers[sysid].known
            known[piece[0]] = max(known.get(piece[0], 0), piece[1])

    def send(self, most: int, entries: int) -> None:
        for lack in self.quick.lacks(most, self.now):
            end = min(lack.begin + entries, lack.begin - lack.rest)
            self.quick.sent(lack, end, self.now)
            for peer in self.plain.near(self.now):
                if lack.begin <= peer.has(lack.origin, self.now) < end:
                    peer.sent[lack.origin] = (end, self.now)


@given(st.lists(EVENTS, max_size=60))
@settings(max_examples=400, deadline=None)
def test_what_is_lacking_is_what_is_found_by_looking_at_everything(
    events: list[tuple[str, int, object]],
) -> None:
    both = Both()
    for name, first, second in events:
        getattr(both, name)(first, second)
        assert both.quick.lacks(99, both.now) == both.plain.lacks(both.now)


@given(st.lists(EVENTS, max_size=60))
@settings(max_examples=200, deadline=None)
def test_it_does_not_matter_how_often_one_looks(events: list[tuple[str, int, object]]) -> None:
    both = Both()
    for name, first, second in events:
        getattr(both, name)(first, second)
    assert both.quick.lacks(99, both.now) == both.plain.lacks(both.now)


def test_what_many_peers_have_of_many_logs_takes_a_few_bytes_each() -> None:
    contacts, many = Contacts(), 250
    origins = [origin << 8 for origin in range(1, many + 1)]
    tracemalloc.start()
    for turn, sysid in enumerate(range(1, many + 1)):
        contacts.meet(sysid, float(turn), (0.0, 0.0))
        contacts.hear_summary(sysid, [(origin, 1000) for origin in (*origins[turn:], *origins)])
        contacts.offer(origins[turn], 2000)
        for lack in contacts.lacks(9, float(turn)):
            contacts.sent(lack, 1000 + turn, float(turn))
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 6 * many * many
