"""What peers tell one another of the ground they have seen, over the radio's broadcasts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from swarm_ctl.agent.beacon import SUMMARY_TYPE, TRAIL_TYPE
from swarm_ctl.agent.peers import PeerTable
from swarm_ctl.agent.phases import BEFORE_START
from swarm_ctl.explore import pieces, trails
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.model import Vec3

MEET_S = 1.0
"""Between two contacts taken note of, and between two summaries; once a second is enough
(ALGORITHM 2.6)."""
TRAILS_PER_BEACON = 2
"""As many as one vehicle told in two ticks of a tenth of a second."""
FRAME_BYTES = 30
"""What a signed TUNNEL adds to a payload."""
TRAIL_BYTES = pieces.PAYLOAD_BYTES + FRAME_BYTES
SUMMARY_BYTES = trails.SUMMARY_BYTES + FRAME_BYTES
SCAN_M = 2.0
"""Scanner hits farther than this are left for later, when they are seen more exactly."""
PEER_M = 0.6
"""Hits this close to a peer are the peer."""


class Sharing:
    """Feed an explorer with what is seen and heard, and give what it has to tell."""

    def __init__(self, explorer: Explorer, dimensions: int) -> None:
        self.explorer = explorer
        self._dimensions = dimensions
        self._next_meeting_s = 0.0
        self._next_summary_s = 0.0

    def see(
        self,
        scan_m: Iterable[tuple[float, float, float]],
        own_ned_m: Vec3,
        peers_m: Sequence[Vec3],
    ) -> None:
        """Take scanner hits, relative to the vehicle; peers are no walls."""
        near_m = [(x, y) for x, y, _ in peers_m if not math.hypot(x, y) > SCAN_M + 2.0 * PEER_M]
        own_x, own_y, own_z = own_ned_m
        points = []
        for x, y, z in scan_m:
            if not math.hypot(x, y) <= SCAN_M:
                continue
            for peer_x, peer_y in near_m:
                if not math.hypot(x - peer_x, y - peer_y) > PEER_M:
                    break
            else:
                points.append((x + own_x, y + own_y, z + own_z)[: self._dimensions])
        if points:
            self.explorer.observe_points(points)

    def meet(self, peers: PeerTable, now: float) -> None:
        """Take note of contacts: who is where, in his frame and in ours."""
        if now < self._next_meeting_s:
            return
        met = peers.met(now)
        if met:
            self._next_meeting_s = now + MEET_S
        d = self._dimensions
        for sysid, beacon, there, here in met:
            if beacon.phase in BEFORE_START:
                continue
            target = None if beacon.target_ned_m is None else beacon.target_ned_m[:d]
            self.explorer.hear_peer(
                sysid, now, [0.0] * d, there[:d], target, own_position_m=here[:d]
            )

    def hear(self, sysid: int, payload_type: int, payload: bytes) -> None:
        """Take a peer's summary or a piece of a trail."""
        if payload_type == SUMMARY_TYPE:
            self.explorer.hear_summary(sysid, payload)
        elif payload_type == TRAIL_TYPE:
            self.explorer.hear_chunk(sysid, payload)

    def outgoing(self, now: float, room_bytes: int) -> list[tuple[int, bytes]]:
        """Give payload types and payloads to broadcast now, as frames no longer than there is room.

        The summary comes first: without it peers would be told again what they know.
        """
        told = []
        if now >= self._next_summary_s and room_bytes >= SUMMARY_BYTES:
            self._next_summary_s = now + MEET_S
            told.append((SUMMARY_TYPE, self.explorer.summary()))
            room_bytes -= SUMMARY_BYTES
        most = max(0, min(TRAILS_PER_BEACON, room_bytes // TRAIL_BYTES))
        return told + [(TRAIL_TYPE, payload) for payload in self.explorer.outbox(most)]
