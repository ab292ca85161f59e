"""What one vehicle tells its peers over their radios, and what becomes of what they tell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from swarm_ctl import wire
from swarm_ctl.agent import beacon as beacons
from swarm_ctl.agent.budget import Budget
from swarm_ctl.agent.frame import shift_between
from swarm_ctl.agent.phases import BEFORE_START, EXPLORES, STEERING, Phase
from swarm_ctl.agent.sharing import Sharing
from swarm_ctl.agent.victims import VICTIMS_TYPE
from swarm_ctl.autopilot.base import COMPANION_COMPONENT

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

HEARTBEAT_S = 1.0


class Talk:
    """Broadcasts of one agent, and those that it hears."""

    def __init__(self, agent: Agent, sharing: Sharing | None) -> None:
        """Speak for an agent; one that shares ground with its peers does so by `sharing`."""
        self.tag = beacons.mission_tag(agent.orders.mission)
        """That of the mission; whose beacons have another one is not ours."""
        self._agent, self._sharing = agent, sharing
        self._budget = Budget()
        self._next_heartbeat_s = self._next_beacon_s = 0.0

    def hear(self, frame: wire.Frame, now: float, *, is_near: bool = True) -> None:
        """Take a peer's broadcast; who has not told that he flies our mission is not ours.

        It `is_near` when the radio brought it that also measures, and no network of a longer reach.
        """
        if frame.compid != COMPANION_COMPONENT:
            return
        agent, peers = self._agent, self._agent.peers
        sysid, payload_type = frame.sysid, frame.values.payload_type
        payload = frame.values.payload[: frame.values.payload_length]
        if payload_type == beacons.BEACON_TYPE:
            beacon = beacons.decode(payload)
            if beacon is None:
                peers.unread += 1
            elif beacon.mission == self.tag:
                shift = shift_between(agent.frame.start(agent.telemetry), beacon.start)
                peers.beacon(sysid, beacon, now, shift, frame.seq, is_near=is_near)
            else:
                peers.estrange(sysid, now)
        elif not peers.is_ours(sysid):
            return
        elif payload_type == VICTIMS_TYPE:
            self._hear_of_victims(sysid, payload, now)
        elif self._sharing is not None:
            self._sharing.hear(sysid, payload_type, payload)

    def tell(self, now: float) -> list[bytes]:
        """Give the frames to broadcast now: what peers must know, then trails as far as fits.

        Those go with a beacon: a datagram costs a network more than what is in it.
        """
        agent, frames = self._agent, []
        sender, victims, peers = agent.sender, agent.victims, agent.peers
        if now >= self._next_heartbeat_s:
            self._next_heartbeat_s = now + HEARTBEAT_S
            frames.append(sender.heartbeat())
        has_place = agent.telemetry.position_s > -math.inf and not agent.vigil.distrust
        is_known = has_place and agent.telemetry.autopilot is not None
        is_beacon_due = is_known and now >= self._next_beacon_s
        if is_beacon_due:
            self._next_beacon_s = now + beacons.PERIOD_S
            frames.append(sender.broadcast(beacons.BEACON_TYPE, beacons.encode(self.beacon())))
        if victims.known and is_known:
            contacts = filter(peers.is_ours, peers.heard(now))
            if payload := victims.outgoing(contacts, now):
                frames.append(sender.broadcast(VICTIMS_TYPE, payload))
        self._budget.spend(frames, now)
        if self._sharing and is_beacon_due and agent.neighbours and agent.phase in STEERING:
            extras = self._sharing.outgoing(now, self._budget.room(now))
            told = [sender.broadcast(*one) for one in extras]
            self._budget.spend(told, now)
            frames += told
        return frames

    def beacon(self) -> beacons.Beacon:
        """Say what the agent is about to do, and where it is."""
        agent, telemetry = self._agent, self._agent.telemetry
        return beacons.Beacon(
            mission=self.tag,
            phase=agent.phase,
            velocity_ned_m_s=telemetry.velocity_ned_m_s,
            position_ned_m=telemetry.position_ned_m,
            target_ned_m=agent.target_ned_m if agent.phase in EXPLORES else None,
            heard=agent.peers.announced(agent.now),
            start=agent.frame.start(telemetry) if self._knows_its_place() else None,
        )

    def _knows_its_place(self) -> bool:
        """Whether what it tells of its place is fresh, and counts from its start."""
        agent = self._agent
        is_fresh = agent.now - agent.telemetry.position_s <= agent.orders.limits.link_hold_s
        return is_fresh and agent.phase is not Phase.CONNECTING

    def _hear_of_victims(self, sysid: int, payload: bytes, now: float) -> None:
        """Take what a peer tells of victims; before the start there is no frame to place them."""
        agent = self._agent
        if agent.is_ended or agent.phase in BEFORE_START:
            return
        meeting = next((met for met in agent.peers.met(now) if met.sysid == sysid), None)
        agent.victims.hear(sysid, payload, meeting)
