"""Topics and payloads of the bus."""

from __future__ import annotations

import json
from typing import Any, NamedTuple, Self

from swarm_ctl.model import Operator

ROOT = "swarm"
MOST_BYTES = 1000
"""A longer payload is no order."""
MOST_ID = 100
"""Characters of an order's id."""
_OPERATORS = {operator.value: operator for operator in Operator}


def order_topic(mission: str, sysid: int | None = None) -> str:
    """Name where orders come: for one vehicle, or for all of a mission."""
    return f"{ROOT}/{mission}/order" if sysid is None else f"{ROOT}/{mission}/{sysid}/order"


def ack_topic(mission: str, sysid: int | None = None) -> str:
    """Name where a vehicle acknowledges; without a sysid, the filter that hears all of them."""
    return f"{ROOT}/{mission}/{'+' if sysid is None else sysid}/ack"


def peers_topic(mission: str, sysid: int | None = None) -> str:
    """Name where a vehicle tells its peers; without a sysid, the filter that hears all of them."""
    return f"{ROOT}/{mission}/{'+' if sysid is None else sysid}/peers"


class Order(NamedTuple):
    """An order as it came, or what is wrong with it."""

    operator: Operator | None
    """None when it could not be read."""
    id: str = ""
    """Chosen by who orders, to know the acknowledgements by; may be empty."""
    error: str = ""
    """What is wrong, in words; empty when nothing is."""

    def dump(self) -> bytes:
        """Write the payload of an order."""
        return json.dumps({"order": self.operator, "id": self.id}).encode()

    @classmethod
    def load(cls, payload: bytes) -> Self:
        """Read a payload: JSON, or the bare word."""
        if len(payload) > MOST_BYTES:
            return cls(None, error=f"longer than {MOST_BYTES} bytes")
        try:
            text = payload.decode().strip()
            said = json.loads(text) if text.startswith("{") else {"order": text}
        except (ValueError, RecursionError):
            return cls(None, error="neither JSON nor a word")
        return cls._read(said)

    @classmethod
    def _read(cls, said: dict[str, Any]) -> Self:
        name, word = said.get("id", ""), said.get("order")
        if not isinstance(name, str) or len(name) > MOST_ID:
            return cls(None, error=f"its id is no text of at most {MOST_ID} characters")
        operator = _OPERATORS.get(word) if isinstance(word, str) else None
        if operator is None:
            return cls(None, name, f"its order is none of {', '.join(_OPERATORS)}")
        return cls(operator, name)


class Ack(NamedTuple):
    """What one vehicle answers to an order."""

    id: str
    """The order's."""
    order: str
    """Empty when it could not be read."""
    accepted: bool
    """Whether it was done, or is so already; else it makes no sense now, or is no order."""
    phase: str
    """What the vehicle does now."""
    time_s: float
    """Mission time."""
    error: str = ""
    """What is wrong with the order, in words; empty when nothing is."""

    def dump(self) -> bytes:
        """Write the payload of an acknowledgement."""
        return json.dumps(self._asdict()).encode()

    @classmethod
    def load(cls, payload: bytes) -> Self | None:
        """Read a payload; None when it is no acknowledgement."""
        try:
            said = json.loads(payload)
            return cls(**{name: said[name] for name in cls._fields})
        except (ValueError, RecursionError, KeyError, TypeError):
            return None
