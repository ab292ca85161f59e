"""Turn MAVLink bytes into messages and back, by functions generated from pymavlink's tables."""

from swarm_ctl.wire.codec import Frame, Message, checksum, message
from swarm_ctl.wire.parser import Parser, split
from swarm_ctl.wire.tally import Stats

__all__ = ["Frame", "Message", "Parser", "Stats", "checksum", "message", "split"]
