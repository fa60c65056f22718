"""The virtual drive's object dictionary: identity, error history, supervision, and the rows of `object_table`.

A write acts on the machine at once. What a controller writes as process data, and what the drive shows of its status in
PDOs, passes the faults of the drive.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from durand import Node
from durand.object_dictionary import Array, Record, Variable
from durand.services.sdo.server import SDODomainAbort

from drivers.config import DriveConfig
from virtual_bench.devices.object_table import SETTINGS, STRUCT_LETTERS, U8, U32, VALUES, Setting, Value
from virtual_bench.devices.pdo_parameters import ABORT_VALUE, Mappable
from virtual_bench.drive.axis import DriveAxis
from virtual_bench.faults.injector import FaultInjector
from virtual_bench.physics.plant import Plant

DEVICE_TYPE = 0x00020192  # servo drive by CiA 402
REVISION, SERIAL = 0x00010000, 1
CONSUMERS = 2
HISTORY = 8
HEARTBEAT_COB = 0x700

STATUS_PLACES = {0x6041: 0, 0x6061: 1, 0x6077: 2}
"""Objects that faults may change, by their place in what `FaultInjector.status` returns."""

CONTROLWORD, SETPOINTS = 0x6040, (0x6071, 0x60FF)


class DriveDictionary:
    """The objects of one drive beside its PDO parameters, in the dictionary of its node."""

    def __init__(self, node: Node, axis: DriveAxis, faults: FaultInjector, plant: Plant, config: DriveConfig) -> None:
        self._od = node.object_dictionary
        self._network = node.network
        self._axis = axis
        self._faults = faults
        self._plant = plant
        self._config = config
        self._consumed: dict[int, int] = {}  # subindex of 0x1016 -> node
        self._add_communication_objects()
        for setting in SETTINGS:
            self._add_setting(setting)
        for value in VALUES:
            self._add_value(value)

    def restore(self) -> None:
        """Bring supervision and heartbeat to their power-on values: nothing supervised, no heartbeat."""
        for subindex in range(1, CONSUMERS + 1):
            self._od.write(0x1016, subindex, 0)
        self._od.write(0x1017, 0, 0)
        self._axis.machine.objects.setpoint_timeout_ms = 0

    def mappable(self) -> dict[tuple[int, int], Mappable]:
        """Return what may travel in PDOs, by index and subindex."""
        machine = self._axis.machine
        table = {}
        for row in VALUES:
            write = None if row.write is None else self._writer(row)
            read = partial(self._shown, STATUS_PLACES[row.object_index]) if row.object_index in STATUS_PLACES else None
            table[row.object_index, row.subindex] = Mappable(
                STRUCT_LETTERS[row.datatype], read or partial(row.read, machine), write
            )
        return table

    def _shown(self, place: int) -> int:
        """Status word, mode display or actual torque as it goes into a PDO, with the drive's faults."""
        machine = self._axis.machine
        torque = min(max(machine.motor.torque_permille, -0x8000), 0x7FFF)
        shown = self._faults.status(machine.statusword, int(machine.motion.mode_display), torque)[place]
        return min(max(shown, -0x8000), 0x7FFF) if place == 2 else shown

    def _writer(self, row: Value) -> Callable[[int], None]:
        machine, write, faults = self._axis.machine, row.write, self._faults
        assert write is not None  # noqa: S101 - the caller has looked

        def write_now(value: int) -> None:
            if row.object_index in SETPOINTS:
                value = faults.setpoint(value, row.read(machine))
            elif row.object_index == CONTROLWORD and not faults.takes_controlword(value, machine.controlword):
                return
            write(machine, value, self._plant.now_ns)

        return write_now

    def _add_communication_objects(self) -> None:
        od, machine = self._od, self._axis.machine
        profile, config = self._config.profile, self._config
        od[0x1000] = Variable(U32, "ro", DEVICE_TYPE, name="Device type")
        od[0x1008].value = b"lostmotion virtual drive"
        identity = od[0x1018]
        for subindex, number in enumerate(
            (profile.profile.vendor_id, profile.profile.product_code, REVISION, SERIAL), start=1
        ):
            identity[subindex].value = number
        od[0x1003] = Array(Variable(U32, "ro", 0, name="Error"), length=HISTORY, name="Pre-defined error field")
        od.set_read_callback(0x1003, 0, lambda: len(machine.history))
        for subindex in range(1, HISTORY + 1):
            od.set_read_callback(0x1003, subindex, partial(_history, machine.history, subindex))
        od[0x1006] = Variable(U32, "rw", 0, name="Communication cycle period")
        od[0x1007] = Variable(U32, "rw", 0, name="Synchronous window length")
        consumers = Record(name="Consumer heartbeat time")
        for subindex in range(1, CONSUMERS + 1):
            consumers[subindex] = Variable(U32, "rw", 0, name="Consumer heartbeat")
            od.update_callbacks[0x1016, subindex].add(partial(self._consume, subindex))
        od[0x1016] = consumers
        behaviour = Record(name="Error behaviour")
        behaviour[1] = Variable(U8, "rw", 1, minimum=1, maximum=1, name="Communication error: no change of state")
        od[0x1029] = behaviour
        rated = round(config.rated_torque_nm * profile.scaling.rated_torque_counts_per_nm)
        od[0x6076] = Variable(U32, "ro", rated, name="Motor rated torque")
        od.update_callbacks[0x1400, 5].add(self._setpoint_timeout)

    def _add_setting(self, row: Setting) -> None:
        od, objects = self._od, self._axis.machine.objects
        variable = Variable(row.datatype, "rw", getattr(objects, row.attribute), name=row.name)
        variable.minimum = max(variable.minimum, row.low)
        od[row.object_index] = variable

        def check(value: int) -> None:
            if row.allowed is not None and value not in row.allowed:
                raise SDODomainAbort(ABORT_VALUE, (row.object_index, 0))

        def take(value: int) -> None:
            setattr(objects, row.attribute, value)
            self._axis.apply_limits()

        od.validate_callbacks[row.object_index, 0].add(check)
        od.update_callbacks[row.object_index, 0].add(take)

    def _add_value(self, row: Value) -> None:
        od, machine = self._od, self._axis.machine
        variable = Variable(row.datatype, "ro" if row.write is None else "rw", 0, name=row.name)
        if not row.subindex:
            od[row.object_index] = variable
        else:
            if row.object_index not in od:
                od[row.object_index] = Record(name=row.name)
            od[row.object_index][row.subindex] = variable
        od.set_read_callback(row.object_index, row.subindex, partial(row.read, machine))
        if row.write is not None:
            od.download_callbacks[row.object_index, row.subindex].add(self._writer(row))

    def _consume(self, subindex: int, value: int) -> None:
        """Take 0x1016: node << 16 | time-out in ms."""
        before = self._consumed.pop(subindex, None)
        if before is not None:
            self._axis.machine.consume_heartbeats_of(before, 0)
            self._network.remove_subscription(HEARTBEAT_COB + before)
        node_id, timeout_ms = value >> 16 & 0x7F, value & 0xFFFF
        if node_id and timeout_ms:
            self._consumed[subindex] = node_id
            self._axis.machine.consume_heartbeats_of(node_id, timeout_ms)
            self._network.add_subscription(HEARTBEAT_COB + node_id, self._heartbeat)

    def _heartbeat(self, cob_id: int, _data: bytes) -> None:
        self._axis.machine.heartbeat(cob_id - HEARTBEAT_COB, self._plant.now_ns)

    def _setpoint_timeout(self, value: int) -> None:
        self._axis.machine.objects.setpoint_timeout_ms = value


def _history(codes: list[int], subindex: int) -> int:
    return codes[subindex - 1] if subindex <= len(codes) else 0
