"""An ideal disc radio: who hears whom, from where, and what is carried when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.sensors.infrared import ned_to_body
from mock_vehicle.sensors.readings import PeerFix

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]


class Radio:
    """The radios of a whole fleet; whoever is powered and within the radius is heard."""

    def __init__(
        self,
        sysids: Sequence[int],
        *,
        radius_m: float,
        delay_s: float = 0.0,
        loss_fraction: float = 0.0,
        ranging: bool = True,
        range_noise_m: float = 0.0,
        bearing_noise_rad: float = 0.0,
        rng: np.random.Generator,
    ) -> None:
        self._sysids = list(sysids)
        self._radius_m = radius_m
        self._delay_s = delay_s
        self._loss_fraction = loss_fraction
        self._ranging = ranging
        self._range_noise_m = range_noise_m
        self._bearing_noise_rad = bearing_noise_rad
        self._rng = rng
        self.extra_loss: FLOATS = np.zeros(len(self._sysids))
        """Share of frames that a vehicle's radio loses beside the usual, (n,)."""
        self._silent = np.zeros(len(self._sysids), dtype=bool)
        self._air: list[tuple[float, int, bytes]] = []
        self.linked: BOOLS = np.zeros((len(self._sysids),) * 2, dtype=bool)
        """`linked[a, b]`: a and b hear each other, as of the last `update`."""

    def silence(self, sysid: int) -> None:
        """Take a vehicle off the air, in both directions, from now on."""
        index = self._sysids.index(sysid)
        self._silent[index] = True
        self.linked[index, :] = False
        self.linked[:, index] = False

    def restore(self, sysid: int) -> None:
        """Bring a silenced vehicle back; it is heard from the next `update`."""
        self._silent[self._sysids.index(sysid)] = False

    def update(self, distances_m: FLOATS, alive: BOOLS) -> None:
        """Find the links for (n, n) distances; a radio that is dead or silenced has none."""
        on_air = alive & ~self._silent
        self.linked = (distances_m <= self._radius_m) & on_air[:, None] & on_air[None, :]
        np.fill_diagonal(self.linked, val=False)

    def fixes(
        self, position_ned_m: FLOATS, attitude_rad: tuple[FLOATS, FLOATS, FLOATS]
    ) -> list[list[PeerFix]]:
        """Measure every heard peer: range, and direction in the hearer's body FRD frame."""
        heard: list[list[PeerFix]] = [[] for _ in self._sysids]
        if not self._ranging:
            return heard
        hearer, peer = np.nonzero(self.linked)
        received = self._receives(hearer, peer)
        hearer, peer = hearer[received], peer[received]
        if not len(hearer):
            return heard
        gap = position_ned_m[peer] - position_ned_m[hearer]
        ranges = np.sqrt(np.einsum("ij,ij->i", gap, gap))
        roll, pitch, yaw = (angle[hearer] for angle in attitude_rad)
        body = ned_to_body(gap / np.maximum(ranges, 1e-9)[:, None], roll, pitch, yaw)
        if self._bearing_noise_rad > 0.0:
            body += self._rng.normal(0.0, self._bearing_noise_rad, body.shape)
            body /= np.sqrt(np.einsum("ij,ij->i", body, body))[:, None]
        if self._range_noise_m > 0.0:
            ranges = np.abs(ranges + self._rng.normal(0.0, self._range_noise_m, ranges.shape))
        rows = zip(hearer.tolist(), peer.tolist(), ranges.tolist(), body.tolist(), strict=True)
        for listener, talker, range_m, (x, y, z) in rows:
            heard[listener].append(PeerFix(self._sysids[talker], range_m, (x, y, z)))
        return heard

    def send(self, index: int, frame: bytes, now: float) -> None:
        """Put a broadcast frame on the air; it arrives after the delay, at the next `carry`."""
        self._air.append((now + self._delay_s, index, frame))

    def carry(self, now: float) -> list[tuple[int, bytes]]:
        """Take what arrives by `now`: (hearer index, frame), in the order of time and sender."""
        if not self._air:
            return []
        due = sorted((item for item in self._air if item[0] <= now), key=lambda item: item[:2])
        self._air = [item for item in self._air if item[0] > now]
        arrived: list[tuple[int, bytes]] = []
        for _, sender, frame in due:
            (hearers,) = np.nonzero(self.linked[sender])
            received = self._receives(hearers, sender)
            arrived += [(hearer, frame) for hearer in hearers[received].tolist()]
        return arrived

    def _receives(self, hearer: INDICES, talker: INDICES | int) -> BOOLS | slice:
        """Lose a fraction of the transmissions."""
        if self._loss_fraction <= 0.0 and not self.extra_loss.any():
            return slice(None)
        extra = np.maximum(self.extra_loss[hearer], self.extra_loss[talker])
        return self._rng.random(len(hearer)) >= np.maximum(self._loss_fraction, extra)
