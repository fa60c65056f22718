"""A sample whose channels come from several devices: what is new, what has grown old, and what counts as one sample."""

from __future__ import annotations

from definitions.image import AGE_NEVER, SampleStatus
from definitions.profiles.can import CanField, CanFrame
from drivers.can.sensors import SensorFrame
from drivers.config import ChannelConfig
from drivers.sample import ComposedSample

PERIOD_NS = 1_000_000


class Box:
    """What a device in the scan is to the sample: its newest values, and the scan they came in."""

    def __init__(self, *names: str) -> None:
        self.names = names
        self.values = [0.0] * (len(names) + 1)
        self.came = self.asked = -1
        self.lost = False

    def place(self, name: str) -> int:
        return self.names.index(name) if name in self.names else -1

    def age_scans(self, scan: int) -> int:
        return scan - self.came if self.came >= 0 else AGE_NEVER

    def measured_scan(self, scan: int, synced_scan: int) -> int:
        assert synced_scan < scan or not scan
        return self.asked if self.asked >= 0 else scan

    def says(self, scan: int, *values: float, asked: int = -1) -> None:
        self.values, self.came, self.asked = [*values, 0.0], scan, asked


def channel(name: str, field: str, **more: object) -> ChannelConfig:
    return ChannelConfig(name, "box", field, **more)  # type: ignore[arg-type]


def value(sample: ComposedSample, name: str) -> float:
    return sample.values[sample.place(name)]


def test_the_counter_moves_when_every_channel_has_come_anew() -> None:
    fast, slow = Box("t"), Box("a")
    sources = [(channel("torque_out_nm", "t", scale=-2.0, zero=1.0), fast), (channel("angle_in_rad", "a"), slow)]
    sample = ComposedSample(sources, PERIOD_NS)
    counters, ages = [], []
    for scan in range(30):
        fast.says(scan, scan)
        if scan % 10 == 5:
            slow.says(scan, 100 + scan)
        sample.take(scan)
        assert value(sample, "torque_out_nm") == 1.0 - 2.0 * scan, "the newest there is, whatever else has come"
        counters.append(value(sample, "sample_counter"))
        ages.append(sample.age_scans(scan))
    assert [scan for scan in range(1, 30) if counters[scan] != counters[scan - 1]] == [5, 15, 25]
    assert ages[4] == AGE_NEVER, "one channel has never come"
    assert ages[5:15] == list(range(10)), "as old as the oldest channel"


def test_without_anything_new_the_values_are_the_same_list() -> None:
    box = Box("t")
    sample = ComposedSample([(channel("torque_out_nm", "t"), box)], PERIOD_NS)
    box.says(0, 1.0)
    sample.take(0)
    values = sample.values
    sample.take(1)
    assert sample.values is values
    assert value(sample, "sample_counter") == 1


def test_a_counter_that_stands_lets_a_value_grow_old_although_answers_come() -> None:
    box = Box("t", "n")
    sample = ComposedSample([(channel("torque_out_nm", "t", proof_field="n"), box)], PERIOD_NS)
    for scan in range(10):
        box.says(scan, 5.0 + scan, min(scan, 3))
        sample.take(scan)
    assert (sample.age_scans(9), value(sample, "sample_counter")) == (6, 4)


def test_noise_may_repeat_a_number_for_as_long_as_is_stated() -> None:
    box = Box("t")
    still = channel("torque_out_nm", "t", proof_field="t", still_s=0.005)
    sample = ComposedSample([(still, box)], PERIOD_NS)
    shown = [1.0, 1.0, 1.0, 2.0, *[2.0] * 20]
    ages = []
    for scan, number in enumerate(shown):
        box.says(scan, number)
        sample.take(scan)
        ages.append(sample.age_scans(scan))
    assert ages[:8] == [0] * 8, "within 5 ms of the last change"
    assert ages[8:] == list(range(1, len(ages) - 7)), "then it counts as frozen"


def test_bits_of_the_devices_and_lost_ones_are_taken_together() -> None:
    one, other = Box("t", "sample_status"), Box("a", "sample_status")
    sample = ComposedSample([(channel("torque_out_nm", "t"), one), (channel("angle_in_rad", "a"), other)], PERIOD_NS)
    one.says(0, 1.0, float(SampleStatus.TORQUE_OUT_SATURATED))
    other.says(0, 1.0, float(SampleStatus.NOT_READY))
    sample.take(0)
    assert value(sample, "sample_status") == SampleStatus.TORQUE_OUT_SATURATED | SampleStatus.NOT_READY
    assert not sample.lost
    other.lost = True
    assert sample.lost


def frame_of(*, synchronous: bool) -> SensorFrame:
    return SensorFrame(CanFrame(0x18B, 1, (CanField("x", 0, 8, "unsigned", "little"),)), synchronous=synchronous)


def test_each_channel_of_a_sample_says_how_long_before_it_it_was_measured() -> None:
    """After SYNC by the scans since it was sent, also over a gap; after a request by the scans since that."""
    by_itself, at_sync, asked = frame_of(synchronous=False), frame_of(synchronous=True), Box("a")
    sources = [(channel("torque_out_nm", "x"), by_itself), (channel("angle_in_rad", "x"), at_sync)]
    sample = ComposedSample([*sources, (channel("angle_out_rad", "a"), asked)], PERIOD_NS)
    names = ("torque_out_delay_scans", "angle_in_delay_scans", "angle_out_delay_scans", "torque_in_delay_scans")
    delays = []
    for scan in (0, 1, 2, 3, 7, 8, 9):  # three periods are missed before scan 7
        by_itself.take(b"a", scan)
        at_sync.take(b"b", scan)
        if scan in (3, 7, 9):
            asked.says(scan, 1.0, asked=scan - 2)
        sample.take(scan)
        delays.append([value(sample, name) for name in names])
    at_3, at_7, at_9 = [0, 1, 2, 0], [0, 4, 2, 0], [0, 1, 2, 0]
    assert delays == [[0, 0, 0, 0]] * 3 + [at_3, at_7, at_7, at_9], "of the sample, until the next is complete"


def test_a_value_that_waits_for_the_others_is_as_old_as_it_is() -> None:
    early, late = Box("t"), Box("a")
    sample = ComposedSample([(channel("torque_out_nm", "t"), early), (channel("angle_in_rad", "a"), late)], PERIOD_NS)
    for scan in range(12):
        if scan == 3:
            early.says(scan, 1.0)
        if scan == 9:
            late.says(scan, 1.0)
        sample.take(scan)
    assert (value(sample, "torque_out_delay_scans"), value(sample, "angle_in_delay_scans")) == (6, 0)
