"""Which vehicle is behind which link, and what there is to say when it is not."""

from __future__ import annotations

from collections.abc import Sequence

from swarm_ctl import wire
from swarm_ctl.controller import Clock
from swarm_ctl.errors import SwarmError
from swarm_ctl.link.shared import Member, SharedLink

HEARD_S = 30.0
"""Mission time after which a vehicle that was never heard is given up."""
OTHERS_S = 1.5
"""Mission time in which all that are there are heard: heartbeats come at 1 Hz."""
HELLO_S = 1.0
SYSID_MAX = 255
_STATION = (245, 191)
"""sysid and compid of a companion that knows no vehicle yet; 255 would be a ground station, whose
silence is a failsafe."""
_HELLO = wire.message("HEARTBEAT").pack(0, *_STATION, 18, 8, 0, 0, 4, 3)


def pair_up(urls: Sequence[str], sysids: Sequence[int]) -> list[tuple[str, int]]:
    """Give each vehicle its link: one sysid counts up, one link leads to all; else they pair up."""
    if len(sysids) == 1:
        sysids = range(sysids[0], sysids[0] + len(urls))
    if len(urls) == 1:
        urls = list(urls) * len(sysids)
    if len(urls) != len(sysids):
        raise SwarmError(
            f"{len(urls)} --connect and {len(sysids)} --sysid do not pair up: give as many of "
            "both, or one --sysid to count up from"
        )
    for sysid in sysids:
        if not 1 <= sysid <= SYSID_MAX:
            raise SwarmError(f"--sysid {sysid}: a vehicle's sysid is 1 to {SYSID_MAX}")
        if list(sysids).count(sysid) > 1:
            raise SwarmError(f"--sysid {sysid}: given twice")
    return list(zip(urls, sysids, strict=True))


async def only_autopilot(shared: SharedLink, speed: float) -> int:
    """Wait for the one autopilot behind a link; SwarmError when there is none or several."""
    clock, hello_s = Clock(speed), 0.0
    shared.watch()
    while not shared.autopilots:
        now = clock.now()
        if now > HEARD_S:
            raise SwarmError(nothing_heard(shared))
        if now >= hello_s and not shared.is_listening:
            hello_s = now + HELLO_S
            shared.link.send(_HELLO)  # who listens on UDP speaks when he is spoken to
        await clock.sleep_until(now + 0.1)
    await clock.sleep_until(clock.now() + OTHERS_S)
    heard = sorted(shared.autopilots)
    if len(heard) > 1:
        raise SwarmError(f"{shared.link.url}: heard {_sysids(heard)}; say which by --sysid")
    return heard[0]


def unheard(link: Member) -> str:
    """Say why a vehicle was not met at its link."""
    if link.source is not None:
        return f"what it sends at {link.url} is not signed with our key"
    heard = sorted(link.shared.autopilots)
    if not heard:
        return nothing_heard(link.shared)
    return f"heard {_sysids(heard)} at {link.url}, but not {link.sysid}"


def nothing_heard(shared: SharedLink) -> str:
    """Say that nobody was there, or nobody who speaks MAVLink."""
    if not shared.is_noise:
        return (
            f"nothing heard at {shared.link.url} within {HEARD_S:.0f} s; is the vehicle on, and "
            "does it speak to this address?"
        )
    hint = " (is the baud rate right?)" if shared.link.url.startswith("serial:") else ""
    return f"heard no MAVLink at {shared.link.url}, only noise{hint}"


def _sysids(heard: Sequence[int]) -> str:
    *others, last = map(str, heard)
    return f"sysids {', '.join(others)} and {last}" if others else f"sysid {last}"
