"""Who else speaks on an autopilot's links, and what is passed on to them."""

from __future__ import annotations

from mock_vehicle.autopilot.link import Link
from swarm_ctl import wire


class Routes:
    """Where each component was heard; frames that are meant for one of them go there.

    Both real autopilots pass on only to other links. One of ours may stand for a network with
    several peers, a ground station beside a companion, so frames go back to the same link, too.
    """

    def __init__(self, sysid: int, compid: int) -> None:
        """Serve the autopilot of this address, whose own frames are never passed on."""
        self._own = sysid, compid
        self._links: dict[tuple[int, int], Link] = {}

    def pass_on(self, frame: wire.Frame, via: Link) -> bool:
        """Send a frame on, as it is, to the component it names; False when none such was heard."""
        source = frame.sysid, frame.compid
        if source != self._own:
            self._links[source] = via
        component = getattr(frame.values, "target_component", 0)
        to = self._links.get((frame.values.target_system, component)) if component else None
        if to is not None:
            to.queue(frame.raw)
        return to is not None
