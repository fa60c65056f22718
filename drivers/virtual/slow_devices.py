"""Amplifier, brake and remote I/O without wires: each asked at its own period, its values ageing in between."""

from __future__ import annotations

from controller.image import AGE_NEVER, Link, Orders
from drivers.virtual.config import BenchConfig
from drivers.virtual.fault_injector import FaultInjector
from drivers.virtual.plant import Plant, Sample

LINKS: dict[str, int] = {
    "amplifier": int(Link.AMPLIFIER),
    "brake": int(Link.BRAKE),
    "remote_io": int(Link.REMOTE_IO),
}
NO_SAMPLE = Sample(0.0, 0.0, 0.0, 0.0, 0, 0, 4)
CURRENT_STEP_A = 1e-3
TEMPERATURE_STEP_C = 0.1


class SlowDevices:
    """The Modbus devices of a bench in virtual time: their values as last sent, and the scans at which they arrive."""

    def __init__(self, config: BenchConfig, plant: Plant, faults: FaultInjector, period_ns: int) -> None:
        self.sample = NO_SAMPLE
        self.brake_values = (0.0, 0)  # current [A], on
        self.io_values = (0, 0, 0.0, 0.0)  # emergency stop released, guard closed, housing and ambient [°C]
        self.sample_scan = self.brake_scan = self.io_scan = -AGE_NEVER
        self._plant = plant
        self._faults = faults
        self._period_ns = period_ns
        self._sample_every = max(round(config.amplifier_poll.every_s * 1e9 / period_ns), 1)
        self._brake_every = max(round(config.brake_poll.every_s * 1e9 / period_ns), 1)
        self._io_every = max(round(config.remote_io_poll.every_s * 1e9 / period_ns), 1)
        self._orders_brake: tuple[int, float] = (0, 0.0)

    def write_brake(self, orders: Orders) -> None:
        """Let the brake's supply take the order, when it is a new one and reaches it."""
        wanted = (orders.brake_on, orders.brake_current_a)
        if wanted == self._orders_brake:
            return
        if self._faults.device("brake")[0] in ("off", "exception", "silence"):
            return
        self._orders_brake = wanted
        current = round(orders.brake_current_a / CURRENT_STEP_A) * CURRENT_STEP_A if orders.brake_on else 0.0
        self._plant.set_brake_current(current)

    def answer(self, scan: int) -> None:
        """Let the devices answer whose turn it is in this scan."""
        plant = self._plant
        undisturbed = not self._faults.active
        if scan % self._sample_every == 0 and (undisturbed or self._answers("amplifier", scan)):
            if undisturbed or not self._frozen("amplifier"):
                self.sample = plant.sample()
            self.sample_scan = scan + 1
        if scan % self._brake_every == 0 and self._answers("brake", scan):
            if not self._frozen("brake"):
                self.brake_values = (plant.brake_current_a, self._orders_brake[0])
            self.brake_scan = scan + 1
        # values of a device whose life counter stands still go on ageing, as in the driver
        if scan % self._io_every == 0 and self._answers("remote_io", scan) and not self._frozen("remote_io"):
            wires = self._faults.wires
            housing_c = plant.housing_temp_c + wires.housing_offset_k
            self.io_values = (
                int(wires.estop_released),
                int(wires.guard_closed),
                round(housing_c / TEMPERATURE_STEP_C) * TEMPERATURE_STEP_C,
                round(plant.ambient_temp_c / TEMPERATURE_STEP_C) * TEMPERATURE_STEP_C,
            )
            self.io_scan = scan + 1

    def links_lost(self) -> int:
        """Return the bits of `Link` for the devices that faults have cut off."""
        return sum(bit for device, bit in LINKS.items() if self._faults.device(device)[0] in ("off", "exception"))

    def _answers(self, device: str, scan: int) -> bool:
        """Whether a request of this scan is answered before the next; a slow device is asked again when it has."""
        verb, value = self._faults.device(device)
        if verb == "slow":
            every = max(round(value * 1e6 / self._period_ns), 1)
            return scan % every == 0
        return verb in ("", "freeze")

    def _frozen(self, device: str) -> bool:
        return self._faults.device(device)[0] == "freeze"
