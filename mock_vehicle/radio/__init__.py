"""The radios between vehicles: who hears whom, from where, and what is carried when."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.pairs import pairs
from mock_vehicle.radio.air import NOTHING, Received, Transmission
from mock_vehicle.radio.channel import Channel
from mock_vehicle.radio.figures import Fate, Figures
from mock_vehicle.radio.partition import Partition
from mock_vehicle.radio.path_loss import PathLoss, Walls
from mock_vehicle.radio.ranging import Ranging
from mock_vehicle.radio.stray import Parcel, Stray
from mock_vehicle.sensors.readings import PeerFix
from mock_vehicle.world.radio import RadioSpec

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]
EVERYBODY = slice(None)
HEARD, OUT_OF_RANGE = np.int8(Fate.HEARD), np.int8(Fate.RANGE)


def no_walls(a_m: FLOATS, b_m: FLOATS) -> INDICES:  # noqa: ARG001
    """Count the solids between (k, 3) pairs of points of an open field."""
    return np.zeros(len(a_m), dtype=np.intp)


class Radio:
    """The radios of a whole fleet; as it comes, whoever is powered and in the radius is heard.

    What goes beyond an ideal disc draws from generators of its own: a disc draws as ever.
    """

    def __init__(
        self,
        sysids: Sequence[int],
        spec: RadioSpec,
        rng: np.random.Generator,
        walls: Walls = no_walls,
        own: slice = EVERYBODY,
    ) -> None:
        """Equip vehicles of these sysids, of whom `own` hear here, and the rest in other shards."""
        self._sysids = list(sysids)
        self._spec = spec
        self._rng = rng
        n = len(self._sysids)
        self.own = own
        self._first = own.start or 0
        self.extra_loss: FLOATS = np.zeros(n)
        """Share of frames that a vehicle's radio loses beside the usual, (n,)."""
        self.linked: BOOLS = np.zeros((n, n), dtype=bool)
        """`linked[a, b]`: b hears a, and a would hear b, as of the last `update`."""
        self._is_elsewhere = np.ones(n, dtype=bool)
        self._is_elsewhere[own] = False
        self._has_elsewhere = bool(self._is_elsewhere.any())
        self.figures = Figures(self._sysids)
        """What became of all frames."""
        self._fate = np.full((n, n), Fate.OFF_AIR, dtype=np.int8)
        self._itself = np.eye(n, dtype=bool)
        self._silent = np.zeros(n, dtype=bool)
        self._air: list[Transmission] = []
        for_stray, for_path, for_channel = rng.spawn(3)
        self._stray = Stray(spec, for_stray)
        self._ranging = None if spec.ranging is None else Ranging(spec.ranging, sysids, rng)
        self._channel = None if spec.channel is None else Channel(spec.channel, n, for_channel)
        self._path_loss = None
        if spec.path_loss is not None:
            self._path_loss = PathLoss(spec.path_loss, spec.radius_m, n, walls, for_path)
        self._partitions = [Partition(one, self._sysids) for one in spec.partitions]

    def compile(self) -> None:
        """Measure peers by compiled loops, where numba is installed; the same bit for bit."""
        if self._ranging is not None:
            self._ranging.compile()

    def silence(self, sysid: int) -> None:
        """Take a vehicle off the air, in both directions, from now on."""
        index = self._sysids.index(sysid)
        self._silent[index] = True
        for links, off_air in ((self.linked, False), (self._fate, Fate.OFF_AIR)):
            links[index, :] = off_air
            links[:, index] = off_air

    def restore(self, sysid: int) -> None:
        """Bring a silenced vehicle back; it is heard from the next `update`."""
        self._silent[self._sysids.index(sysid)] = False

    def update(self, distances_m: FLOATS, alive: BOOLS, position_ned_m: FLOATS, now: float) -> None:
        """Find the links for (n, n) distances; a radio that is dead or silenced has none."""
        if self._path_loss is None:
            fate = ((distances_m > self._spec.radius_m) | self._itself) * OUT_OF_RANGE
        else:
            fate = self._path_loss.fates(distances_m, position_ned_m, now)
        for partition in self._partitions:
            if partition.lasts(now):
                fate[partition.parts(position_ned_m) & (fate == Fate.HEARD)] = Fate.PARTITION
        off_air = ~alive | self._silent
        if np.count_nonzero(off_air):
            fate[off_air, :] = fate[:, off_air] = Fate.OFF_AIR
        if self._has_elsewhere:  # their own shards know better what they hear
            fate[:, self._is_elsewhere] = Fate.OFF_AIR
        self._fate, self.linked = fate, fate == HEARD

    def fixes(
        self, position_ned_m: FLOATS, attitude_rad: tuple[FLOATS, FLOATS, FLOATS], now: float
    ) -> list[list[PeerFix]]:
        """Measure every heard peer: range, and direction in the hearer's body FRD frame.

        Positions are those of all, the attitude and what is measured those of the own vehicles.
        """
        if self._ranging is None:
            return [[] for _ in self._sysids[self.own]]
        if self._has_elsewhere:
            roll, pitch, yaw = map(self._among_all, attitude_rad)
            attitude_rad = roll, pitch, yaw
        hearer, peer = pairs(self.linked.T)
        if self._is_lossy:
            received = self._receives(hearer, peer)
            hearer, peer = hearer[received], peer[received]
        fixes = self._ranging.measure((hearer, peer), position_ned_m, attitude_rad, now)
        return fixes[self.own]

    def _among_all(self, values: FLOATS) -> FLOATS:
        """Give values of the own vehicles their places among all, which have 0."""
        all_values = np.zeros(len(self._sysids))
        all_values[self.own] = values
        return all_values

    @property
    def on_air(self) -> BOOLS:
        """Which own vehicles are not silenced."""
        return ~self._silent[self.own]

    def send(self, index: int, frame: bytes, now: float) -> None:
        """Put a frame of an own vehicle on the air; it arrives after the delay, at a `carry`."""
        index += self._first
        if self._channel is None:
            self._air.append(Transmission(now + self._spec.delay_s, index, frame, now))
        elif not self._channel.send(index, frame, now):
            fates = self._fate[[index]]
            fates[fates == Fate.HEARD] = Fate.QUEUE
            self.figures.meet(np.array([index]), fates)

    def overhear(self, index: int, frame: bytes, sent_s: float) -> None:
        """Put a frame on the air that one of all vehicles sent in another shard."""
        self._air.append(Transmission(sent_s + self._spec.delay_s, index, frame, sent_s))

    def weaken(self, index: int, fraction: float) -> None:
        """Let the radio of an own vehicle lose this share of frames beside the usual."""
        self.extra_loss[self._first + index] = fraction

    def carry(self, now: float) -> list[tuple[int, bytes]]:
        """Take what arrives by `now`: (own index of hearer, frame), by time and sender."""
        if self._channel is not None:
            sent, delay_s = self._channel.run(now, self.linked), self._spec.delay_s
            self._air += [one._replace(due_s=one.due_s + delay_s) for one in sent]
        received = self._receive(now) if self._air else NOTHING
        if self._stray.is_needed:
            self._stray.hold(received)
            return self._come_in(self._stray.take(now), now)
        if not received.transmissions:
            return []
        self.figures.deliver(received, now)
        return [(hearer - self._first, one.frame) for hearer, one in received.pairs()]

    def _receive(self, now: float) -> Received:
        """Let the hearers of all that is due receive it, or not."""
        due = [one for one in self._air if one.due_s <= now]
        if not due:
            return NOTHING
        due.sort(key=itemgetter(0, 1))
        self._air = [one for one in self._air if one.due_s > now]
        senders = np.array([one.sender for one in due])
        fates = self._fate[senders]
        for row, one in enumerate(due):
            if one.spoilt:
                at = list(one.spoilt)
                fates[row, at] = np.where(fates[row, at] == HEARD, Fate.COLLISION, fates[row, at])
        rows, hearers = (fates == HEARD).nonzero()
        if self._is_lossy:
            received = self._receives(hearers, senders[rows])
            if np.count_nonzero(received) < len(received):
                fates[rows[~received], hearers[~received]] = Fate.LOSS
                rows, hearers = rows[received], hearers[received]
        self.figures.meet(senders, fates)
        return Received(due, rows, hearers)

    def _come_in(self, parcels: list[Parcel], now: float) -> list[tuple[int, bytes]]:
        first = [parcel for parcel in parcels if not parcel.is_copy]
        if first:
            hearers = np.array([parcel.hearer for parcel in first])
            every = [parcel.transmission for parcel in first]
            self.figures.deliver(Received(every, np.arange(len(first)), hearers), now)
        for parcel in parcels:
            if parcel.is_copy:
                self.figures.repeat(parcel.transmission.sender, parcel.hearer)
        return [(p.hearer - self._first, p.transmission.frame) for p in parcels]

    @property
    def _is_lossy(self) -> bool:
        return self._spec.loss_fraction > 0.0 or bool(np.count_nonzero(self.extra_loss))

    def _receives(self, hearer: INDICES, talker: INDICES) -> BOOLS:
        """Lose a fraction of the transmissions."""
        lost: float | FLOATS = self._spec.loss_fraction
        if np.count_nonzero(self.extra_loss):
            extra = np.maximum(self.extra_loss[hearer], self.extra_loss[talker])
            lost = np.maximum(lost, extra)
        received: BOOLS = self._rng.random(len(hearer)) >= lost
        return received
