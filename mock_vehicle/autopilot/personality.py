"""What PX4 and ArduPilot decide differently: tables, and a method per question."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from mock_vehicle.autopilot.auto_rules import AutoRules
from mock_vehicle.autopilot.boot import Announcement
from mock_vehicle.autopilot.fences import FenceSettings
from mock_vehicle.autopilot.link import Encoder, Link
from mock_vehicle.autopilot.manoeuvres import (
    Setpoint,
)
from mock_vehicle.autopilot.parameters import Dialect
from mock_vehicle.autopilot.plans import Item, PlanRules
from mock_vehicle.autopilot.traits import (
    SystemStatus,
    Traits,
)

if TYPE_CHECKING:
    from mock_vehicle.autopilot.commands import CommandHandler, MessageHandler


class Personality(ABC):
    """The questions that an autopilot asks of its kind."""

    mode: int
    """custom_mode, as it was chosen."""
    traits: Traits
    """As recorded, and in each vehicle as its parameters say."""
    dialect: ClassVar[Dialect]
    """How it speaks of parameters."""
    command_table: ClassVar[Mapping[int, CommandHandler]]
    """By MAV_CMD; what is not here is UNSUPPORTED."""
    message_table: ClassVar[Mapping[int, MessageHandler]]
    """By message id; what is not here is ignored."""
    streamable: ClassVar[Mapping[int, Encoder]]
    """Messages with an interval, by id."""
    requestable: ClassVar[Mapping[int, Encoder]]
    """Messages that REQUEST_MESSAGE gives, by id."""
    plan_rules: ClassVar[PlanRules]
    auto_rules: ClassVar[AutoRules]
    fence_settings: FenceSettings
    """What the parameters say of the fence."""
    mission_mode: ClassVar[int]
    """The mode that flies the mission."""
    announcements: ClassVar[Sequence[Announcement]] = ()
    """What it says while it boots."""
    stream_groups: ClassVar[Mapping[int, Sequence[int]]] = {}
    """Message ids by the stream of REQUEST_DATA_STREAM."""

    acks_left: float = math.inf
    """How many commands it still acknowledges in its present loop."""
    ordered_faults: frozenset[str] = frozenset()
    """Kinds of faults that its own parameters ask for."""

    @property
    @abstractmethod
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode without the armed bit."""

    @property
    def reported_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.mode

    @abstractmethod
    def tuned(self) -> Traits:
        """Give the numbers as the parameters say."""

    @abstractmethod
    def system_status(self, now: float) -> SystemStatus:
        """HEARTBEAT.system_status."""

    @abstractmethod
    def accepts_command(self, system: int, component: int, number: int) -> bool:
        """Whether a command with this target is for us."""

    @abstractmethod
    def accepts_setpoint(self, system: int, component: int) -> bool:
        """Whether a setpoint with this target is for us."""

    @abstractmethod
    def arming_refusals(self, now: float, *, force: bool) -> list[str] | None:
        """Say why arming is refused (perhaps without words), or None when it is not."""

    @abstractmethod
    def receive_setpoint(self, values: Any, now: float) -> None:
        """Take a SET_POSITION_TARGET_LOCAL_NED that is for us."""

    @abstractmethod
    def receive_attitude(self, setpoint: Setpoint, now: float) -> None:
        """Take a SET_ATTITUDE_TARGET that is for us, as accelerations and a climb."""

    @abstractmethod
    def advance(self, now: float) -> None:
        """Run the personality's own timers."""

    @abstractmethod
    def takeoff_done(self, now: float) -> None:
        """Go on after a take-off."""

    @abstractmethod
    def sensor_bits(self, now: float) -> tuple[int, int, int]:
        """MAV_SYS_STATUS_SENSOR bits present, enabled and healthy, without the arming check."""

    @abstractmethod
    def announce_origin(self, now: float) -> None:
        """Tell unasked where the origin lies on the globe, which is new."""

    @abstractmethod
    def announce_home(self, now: float) -> None:
        """Tell unasked where home lies on the globe, which is new."""

    @property
    def banner(self) -> Sequence[str]:
        """What it says of itself before a list of parameters."""
        return ()

    @property
    def is_on_mission(self) -> bool:
        """What MISSION_CURRENT says of the mode."""
        return self.mode == self.mission_mode

    @property
    def bars_mission(self) -> bool:
        """Whether the fence forbids the mission as it is."""
        return False

    def take_guided_item(self, item: Item, current: int, now: float) -> int | None:  # noqa: ARG002
        """Fly to a MISSION_ITEM that is none of a plan; a MAV_MISSION_RESULT, None is silence."""
        return None

    def may_speak(self, link: Link, now: float) -> bool:  # noqa: ARG002 - PX4 looks who listens
        """Whether STATUSTEXT is sent over a link at all."""
        return True
