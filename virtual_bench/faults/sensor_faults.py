"""What faults make of the measuring channels: of single values, between the plant and whoever reads them."""

from __future__ import annotations

from virtual_bench.faults.scenario import Fault
from virtual_bench.faults.schedule import FaultSchedule
from virtual_bench.physics.decay import decay_of
from virtual_bench.physics.plant import Plant, Sample
from virtual_bench.physics.plant_numbers import CH
from virtual_bench.physics.plant_sensors import CHANNELS

NOT_A_NUMBER = float("nan")
AT_THE_SENSOR = ("offset", "stuck")
"""Verbs that the plant's own sensor model has; the others change a sample that was taken."""

PREFIX = "sensor."


class SensorFaults:
    """Disturbs the channels of a plant by the active faults of a schedule."""

    def __init__(self, schedule: FaultSchedule, plant: Plant) -> None:
        self._schedule = schedule
        self._plant = plant
        self._lagging: dict[str, tuple[int, float]] = {}  # time of the last sample [µs] and its lagging value

    def start(self, fault: Fault) -> bool:
        """Start a fault and return whether that alone is its effect."""
        channel = CHANNELS.index(fault.target.removeprefix(PREFIX))
        row = self._plant.channels[channel]
        if fault.verb == "offset":
            row[CH.FAULT_OFFSET] = fault.value or 0.0
            return True
        if fault.verb == "stuck":
            row[CH.STUCK_AT] = self._plant.sample()[channel]
            row[CH.STUCK] = 1.0
            return True
        self._plant.overlay = self._overlay
        return False

    def end(self, fault: Fault) -> None:
        """End a fault that is not active any more."""
        row = self._plant.channels[CHANNELS.index(fault.target.removeprefix(PREFIX))]
        row[CH.FAULT_OFFSET] = row[CH.STUCK] = 0.0
        self._plant.measure_again()
        self._lagging.pop(fault.target, None)
        disturbed = any(target.startswith(PREFIX) for target, _ in self._schedule.active)
        self._plant.overlay = self._overlay if disturbed else None

    def _overlay(self, sample: Sample) -> Sample:
        """Return a sample as the faults of its channels leave it."""
        values = list(sample[: len(CHANNELS)])
        status = sample.status
        for (target, verb), fault in tuple(self._schedule.active.items()):
            if not target.startswith(PREFIX) or verb in AT_THE_SENSOR:
                continue
            channel = CHANNELS.index(target.removeprefix(PREFIX))
            before = values[channel]
            if verb == "saturate":
                status |= 1 << channel
            else:
                values[channel] = self._disturbed(fault, before, sample.time_us)
            if values[channel] != before or status != sample.status:
                self._schedule.seen(target)
        return Sample(values[0], values[1], values[2], values[3], sample.counter, sample.time_us, status)

    def _disturbed(self, fault: Fault, before: float, time_us: int) -> float:  # noqa: PLR0911 - one per verb
        key, value = (fault.target, fault.verb), fault.value or 0.0
        match fault.verb:
            case "drift":
                return before + value * (self._plant.now_ns - self._schedule.since_ns[key]) * 1e-9
            case "spike":
                return before + value if self._schedule.count_down(key, 1.0) else before
            case "flip":
                return -before
            case "scale":
                return before * value
            case "noise":
                return before + self._schedule.dice.gauss(0.0, value)
            case "lag":
                return self._lag(fault.target, before, time_us, value)
        return NOT_A_NUMBER

    def _lag(self, target: str, now: float, time_us: int, time_constant_s: float) -> float:
        """Return a value behind a first-order lag that began at the first sample."""
        before_us, lagging = self._lagging.get(target, (time_us, now))
        lagging += (now - lagging) * (1.0 - decay_of((time_us - before_us) * 1e-6 / time_constant_s))
        self._lagging[target] = (time_us, lagging)
        return lagging
