"""The sample of a bench whose measured channels come from several devices: taken together, each with its own proof.

Every value is in the image as soon as it has come: interlocks and the ramp look at the newest there is. The counter of
samples moves when all channels have come anew since it moved last: such a sample is what the analysis takes, and in it
no channel is older than its own device makes it. The sample is as old as the oldest of its channels.

A value that was asked for is older than its arrival: by one period after SYNC, and with the period it grows. So a
sample carries how long before it each channel was measured, and the analysis puts them on one clock.

A device that answers and measures no more is not seen by its answers: what shows that a value is new is told for each
channel (`drivers.config.ChannelConfig`). While that does not show, the value grows old although answers come.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from definitions.image import AGE_NEVER
from drivers.config import ALL_CHANNELS, ChannelConfig

SAMPLE_FIELDS = (*ALL_CHANNELS, "sample_counter", "sample_time_us", "sample_status")
"""What an amplifier delivers, in the order in which the image takes it."""

DELAY_FIELDS = tuple(f"{channel.rsplit('_', 1)[0]}_delay_scans" for channel in ALL_CHANNELS)
"""How long before the sample each channel was measured, in the order of the channels."""

STATUS = "sample_status"
"""Field of a device that reports the bits of `definitions.image.SampleStatus` as the image has them."""

NO_FIELD = -1
_COUNTER, _TIME, _STATUS = (SAMPLE_FIELDS.index(name) for name in ("sample_counter", "sample_time_us", "sample_status"))
_DELAYS = len(SAMPLE_FIELDS)
_UINT32 = 0xFFFF_FFFF


class Feed(Protocol):
    """A block of a device in the scan: `values` is another list whenever it has said something, and one first."""

    values: list[float]

    def place(self, name: str) -> int:
        """Index of a field in `values`; NO_FIELD when there is none."""

    def age_scans(self, scan: int) -> int:
        """Age of the values."""

    @property
    def lost(self) -> bool:
        """Whether its connection is gone."""


class Source(Feed, Protocol):
    """A block of which a channel is taken."""

    def measured_scan(self, scan: int, synced_scan: int) -> int:
        """Scan in which values that came in `scan` were asked for; SYNC was sent last in `synced_scan`."""


class _Channel:
    """One channel: where its value is, and when it was new last."""

    __slots__ = (
        "at",
        "came",
        "changed",
        "feed",
        "is_new",
        "measured",
        "place",
        "proof",
        "proven_by",
        "scale",
        "seen",
        "still",
        "zero",
    )

    def __init__(self, config: ChannelConfig, feed: Source, still_scans: int) -> None:
        self.feed, self.place, self.scale, self.zero = feed, feed.place(config.field), config.scale, config.zero
        self.at = ALL_CHANNELS.index(config.channel)
        self.proof = feed.place(config.proof_field) if config.proof_field else NO_FIELD
        self.still = still_scans
        self.seen: list[float] = feed.values
        self.proven_by: float | None = None
        self.changed = self.came = self.measured = -1
        self.is_new = False

    def take(self, values: list[float], scan: int, synced_scan: int) -> None:
        """Look whether values that have just come are new ones."""
        self.seen = values
        if self.proof != NO_FIELD:
            proof = values[self.proof]
            if proof != self.proven_by:
                self.proven_by, self.changed = proof, scan
            elif scan - self.changed >= self.still:
                return  # a frozen device that goes on answering: its value grows old
        age_scans = self.feed.age_scans(scan)
        if age_scans < AGE_NEVER:
            self.came = scan - age_scans
            self.measured = self.feed.measured_scan(scan, synced_scan)
            self.is_new = True


class ComposedSample:
    """What the image takes for the measuring amplifier on a bench that names the source of each channel.

    Channels that the bench does not have read 0, as fields that an amplifier does not have.
    """

    def __init__(self, channels: Sequence[tuple[ChannelConfig, Source]], period_ns: int) -> None:
        """Prepare the tables; each channel with the feed that has its field."""
        self._channels = tuple(
            _Channel(config, feed, max(round(config.still_s * 1e9 / period_ns), 0)) for config, feed in channels
        )
        self._period_ns = period_ns
        self._feeds = tuple(dict.fromkeys(feed for _, feed in channels))
        self._statuses = tuple((feed, feed.place(STATUS)) for feed in self._feeds if feed.place(STATUS) != NO_FIELD)
        self.values: list[float] = [0.0] * (len(SAMPLE_FIELDS) + len(ALL_CHANNELS))
        self._synced_scan = 0

    def place(self, name: str) -> int:
        """Index of a field in `values`; the delays stand behind what an amplifier delivers too."""
        return (*SAMPLE_FIELDS, *DELAY_FIELDS).index(name)

    @property
    def lost(self) -> bool:
        """Whether the connection to one of the devices is gone."""
        return any(feed.lost for feed in self._feeds)

    def take(self, scan: int) -> None:
        """Take what the devices have said in this scan."""
        taken: list[float] | None = None
        complete = True
        synced_scan, self._synced_scan = self._synced_scan, scan
        for channel in self._channels:
            values = channel.feed.values
            if values is not channel.seen:
                if taken is None:
                    taken = self.values.copy()
                channel.take(values, scan, synced_scan)
                taken[channel.at] = values[channel.place] * channel.scale + channel.zero
            complete &= channel.is_new
        if taken is None:
            return
        if complete:
            for channel in self._channels:
                channel.is_new = False
                taken[_DELAYS + channel.at] = scan - channel.measured
            taken[_COUNTER] = int(taken[_COUNTER]) + 1 & _UINT32
            taken[_TIME] = scan * self._period_ns // 1000 & _UINT32
        status = 0
        for feed, place in self._statuses:
            status |= int(feed.values[place])
        taken[_STATUS] = status
        self.values = taken

    def age_scans(self, scan: int) -> int:
        """Age of the oldest channel."""
        came = min(channel.came for channel in self._channels)
        return scan - came if came >= 0 and scan - came < AGE_NEVER else AGE_NEVER
