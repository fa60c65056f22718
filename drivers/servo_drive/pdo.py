"""Process data objects: a whole PDO packed or unpacked at once, from the mapping in the profile.

One `struct` call per frame: object by object would cost ten times as much in every scan.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from definitions.number_formats import LETTERS
from definitions.profiles.drive import MappedObject, ReceivePdo, TransmitPdo

NMT_COB_ID = 0x000
SYNC_COB_ID = 0x080
EMCY_BASE = 0x080
TPDO_BASES = (0x180, 0x280, 0x380, 0x480)
RPDO_BASES = (0x200, 0x300, 0x400, 0x500)
SDO_ANSWER_BASE = 0x580
SDO_REQUEST_BASE = 0x600
HEARTBEAT_BASE = 0x700


def rpdo_cob_id(pdo: ReceivePdo, node_id: int) -> int:
    """COB-ID of a receive PDO: its own, or that of the predefined connection set (CiA 301), which 1 to 4 have."""
    return RPDO_BASES[pdo.number - 1] + node_id if pdo.cob_id is None else pdo.cob_id


def tpdo_cob_id(pdo: TransmitPdo, node_id: int) -> int:
    """COB-ID of a transmit PDO; as `rpdo_cob_id`."""
    return TPDO_BASES[pdo.number - 1] + node_id if pdo.cob_id is None else pdo.cob_id


class PdoCodec:
    """Codec of one PDO: `names` in the order of the mapping, little-endian without padding."""

    def __init__(self, objects: Sequence[MappedObject]) -> None:
        self.names = tuple(item.name for item in objects)
        self._struct = struct.Struct("<" + "".join(LETTERS[item.type] for item in objects))
        self.size = self._struct.size
        self.unpack = self._struct.unpack
        """The values of a frame of exactly `size` bytes; `struct.error` otherwise."""
        self.pack = self._struct.pack
        """`pack(*values)`; `struct.error` when a value is outside its type."""
