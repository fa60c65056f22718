"""Mapping of the drive's PDOs to what its profile says, as rows of the set-up; PDOs that it does not name are off."""

from __future__ import annotations

from collections.abc import Iterator

from definitions.profiles.drive import ReceivePdo, TransmitPdo
from drivers.config import DriveConfig
from drivers.servo_drive.objects import ALL_BITS, SetupRow, Treatment, milliseconds
from drivers.servo_drive.pdo import rpdo_cob_id, tpdo_cob_id

COB_INVALID = 1 << 31
COB_NO_RTR = 1 << 30
"""TPDO COB-IDs carry it or not at the drive's choice: it is written, and left out of the comparison."""
PDO_NUMBERS = range(1, 9)
"""Those that a profile may use, and four more that drives have: what nobody asked for would fill the bus."""

_FIXED_NEXT = (
    "this drive has fixed process data (PDO mapping): list its objects in the drive profile, unused ones as 'ignored'"
)
_MAPPING_NEXT = "correct the PDO mapping in the drive profile, or restore the drive's PDO defaults"


def mapping_groups(config: DriveConfig) -> list[list[SetupRow]]:
    """Rows of each PDO in the order that CiA 301 asks for: off, type, no entries, entries, their number, on."""
    groups: list[list[SetupRow]] = []
    receive = {pdo.number: pdo for pdo in config.profile.receive_pdos}
    transmit = {pdo.number: pdo for pdo in config.profile.transmit_pdos}
    for number in PDO_NUMBERS:
        if number in receive:
            groups.append(list(_receive_rows(receive[number], config)))
        else:
            groups.append([_switched_off(0x1400 + number - 1)])
        if number in transmit:
            groups.append(list(_transmit_rows(transmit[number], config)))
        else:
            groups.append([_switched_off(0x1800 + number - 1)])
    return groups


def _switched_off(index: int) -> SetupRow:
    return SetupRow(
        index,
        1,
        "u32",
        COB_INVALID,
        "PDO not used, switched off",
        Treatment.WRITE_IF_THERE,
        _MAPPING_NEXT,
        compare_mask=COB_INVALID,
    )


def _receive_rows(pdo: ReceivePdo, config: DriveConfig) -> Iterator[SetupRow]:
    index = 0x1400 + pdo.number - 1
    name = f"set-point PDO {pdo.number}"
    supervised = SetupRow(
        index, 5, "u16", milliseconds(config.setpoint_timeout_s), f"{name}: longest time without it (ms)"
    )
    unsupervised = SetupRow(
        index, 5, "u16", 0, f"{name}: its absence is not supervised", treatment=Treatment.WRITE_IF_THERE
    )
    yield from _mapped(pdo, index, rpdo_cob_id(pdo, config.node_id), name)
    yield supervised if pdo.timeout else unsupervised
    yield _switched_on(index, rpdo_cob_id(pdo, config.node_id), name)


def _transmit_rows(pdo: TransmitPdo, config: DriveConfig) -> Iterator[SetupRow]:
    index = 0x1800 + pdo.number - 1
    name = f"drive PDO {pdo.number}"
    cob_id = tpdo_cob_id(pdo, config.node_id) | COB_NO_RTR
    yield from _mapped(pdo, index, cob_id, name)
    # by these a drive would hold back what it has at a SYNC, or send it at other times too
    for subindex, what in ((3, "inhibit time"), (5, "event timer")):
        yield SetupRow(index, subindex, "u16", 0, f"{name}: no {what}", Treatment.WRITE_IF_THERE, _MAPPING_NEXT)
    yield _switched_on(index, cob_id, name)


def _mapped(pdo: ReceivePdo | TransmitPdo, index: int, cob_id: int, name: str) -> Iterator[SetupRow]:
    mapping = index + 0x200
    if pdo.fixed_mapping:
        yield from _checked(pdo, mapping, name)
    yield SetupRow(index, 1, "u32", cob_id | COB_INVALID, f"{name}: off", Treatment.STEP, _MAPPING_NEXT)
    yield SetupRow(index, 2, "u8", pdo.transmission_type, f"{name}: transmission type", Treatment.WRITE, _MAPPING_NEXT)
    if pdo.fixed_mapping:
        return
    yield SetupRow(mapping, 0, "u8", 0, f"{name}: mapping cleared", Treatment.STEP, _MAPPING_NEXT)
    for place, item in enumerate(pdo.objects, start=1):
        yield SetupRow(mapping, place, "u32", item.mapping, f"{name}: {item.name}", Treatment.WRITE, _MAPPING_NEXT)
    yield SetupRow(mapping, 0, "u8", len(pdo.objects), f"{name}: entries", Treatment.WRITE, _MAPPING_NEXT)


def _checked(pdo: ReceivePdo | TransmitPdo, mapping: int, name: str) -> Iterator[SetupRow]:
    """Rows of a mapping that is the drive's own, and is only compared with the profile's."""
    yield SetupRow(mapping, 0, "u8", len(pdo.objects), f"{name}: entries", Treatment.CHECK, _FIXED_NEXT)
    for place, item in enumerate(pdo.objects, start=1):
        yield SetupRow(mapping, place, "u32", item.mapping, f"{name}: {item.name}", Treatment.CHECK, _FIXED_NEXT)


def _switched_on(index: int, cob_id: int, name: str) -> SetupRow:
    return SetupRow(index, 1, "u32", cob_id, f"{name}: COB-ID", Treatment.WRITE, _MAPPING_NEXT, ALL_BITS & ~COB_NO_RTR)
