"""EDS files of drives for tests, written from which objects such drives have: no maker's file is copied.

A drive is a table; `eds_text` makes the file of it, with what such files have in the wild: blanks in `$NODEID + 0x200`,
`AccessType=rww`, empty defaults, sections that are incomplete.
"""

from __future__ import annotations

from typing import NamedTuple

CODES = {"i8": 2, "i16": 3, "i32": 4, "u8": 5, "u16": 6, "u32": 7, "text": 9}
CHANGED_LATER, TYPE_255 = "0x80000000", "255"


class Entry(NamedTuple):
    """One object: type, access, default as the file has it, whether it may be mapped."""

    type: str
    access: str = "rw"
    default: str = "0"
    mappable: bool = False


class Drive(NamedTuple):
    """One drive: name, vendor, product, its objects, its PDO mappings, and how they may be changed.

    `receive`, `transmit`: for each PDO its mapped objects as `0xIIIISSLL`. `pdo_subindices`: of the communication
    parameters, beside COB-ID and type.
    """

    name: str
    vendor: int
    product: int
    objects: dict[int | tuple[int, int], Entry]
    receive: tuple[tuple[int, ...], ...]
    transmit: tuple[tuple[int, ...], ...]
    fixed: bool = False
    receive_subindices: tuple[int, ...] = ()
    transmit_subindices: tuple[int, ...] = (3, 5)


def _cia402(**extra: Entry) -> dict[int | tuple[int, int], Entry]:
    """Return the objects that all three have, and more by their hexadecimal index."""
    common: dict[int | tuple[int, int], Entry] = {
        0x1000: Entry("u32", "ro", "0x00020192"),
        0x1001: Entry("u8", "ro", "0", mappable=True),
        0x1005: Entry("u32", "rw", "0x80"),
        (0x1016, 1): Entry("u32"),
        0x1017: Entry("u16"),
        0x603F: Entry("u16", "ro", "0", mappable=True),
        0x6040: Entry("u16", "rww", "0", mappable=True),
        0x6041: Entry("u16", "ro", "", mappable=True),
        0x605A: Entry("i16", "rw", "2"),
        0x605E: Entry("i16", "rw", "2"),
        0x6060: Entry("i8", "rww", "0", mappable=True),
        0x6061: Entry("i8", "ro", "0", mappable=True),
        0x6064: Entry("i32", "ro", "0", mappable=True),
        0x606C: Entry("i32", "ro", "0", mappable=True),
        0x6071: Entry("i16", "rww", "0", mappable=True),
        0x6076: Entry("u32", "rw", "5000"),
        0x6077: Entry("i16", "ro", "0", mappable=True),
        0x6080: Entry("u32", "rw", "6000"),
        0x6098: Entry("i8", "rw", "37"),
        0x60FF: Entry("i32", "rww", "0", mappable=True),
        0x6502: Entry("u32", "ro", "0x3A5"),
    }
    return common | {int(index[1:], 16): entry for index, entry in extra.items()}


EPOS4_LIKE = Drive(
    name="EPOS4 like",
    vendor=0x000000FB,
    product=0x12340000,
    objects=_cia402(
        x1001=Entry("u8", "ro", "0"),
        x6007=Entry("i16", "rw", "1"),
        x6073=Entry("u16", "ro", "1100"),
        x60A9=Entry("u32", "rw", "0x00B44700"),
        x60B2=Entry("i16", "rww", "0", mappable=True),
    ),
    receive=((0x60400010,), (0x60400010, 0x60600008), (0x60400010, 0x607A0020), (0x60400010, 0x60FF0020)),
    transmit=((0x60410010,), (0x60410010, 0x60610008), (0x60410010, 0x60640020), (0x60410010, 0x606C0020)),
    transmit_subindices=(3,),
)
"""No 0x6072, 0x6087, 0x1400:5, 0x1006; 0x6073 limits the current; velocity in rpm; an inhibit time, no timer.

0x1001 cannot be mapped.
"""

NANOTEC_LIKE = Drive(
    name="Nanotec like",
    vendor=0x0000026C,
    product=0x00560000,
    objects=_cia402(
        x1006=Entry("u32"),
        x1019=Entry("u8"),
        x6007=Entry("i16", "rw", "1"),
        x6072=Entry("u16", "rww", "1000", mappable=True),
        x6073=Entry("u16", "rw", "1000"),
        x6087=Entry("u32", "rw", "1000"),
        x607E=Entry("u8"),
        x60A9=Entry("u32", "rw", "0x00B44700"),
    )
    | {(0x608F, 1): Entry("u32", "rw", "2000"), (0x608F, 2): Entry("u32", "rw", "1")}
    | {(0x60C2, 1): Entry("u8", "rw", "1"), (0x60C2, 2): Entry("i8", "rw", "-3")},
    receive=((0x60400010,),) * 8,
    transmit=((0x60410010,),) * 8,
    receive_subindices=(5,),
)
"""Every object; eight PDOs each way."""

FIXED_MAPPING = Drive(
    name="Fixed mapping",
    vendor=0x00000123,
    product=0x00000456,
    objects=_cia402(
        x6072=Entry("u16", "ro", "1100"),
        x6087=Entry("u32", "rw", "1000"),
        x60B2=Entry("i16", "rww", "0", mappable=True),
    ),
    receive=((0x60400010, 0x60600008, 0x60710010, 0x60B20010), (0x60400010, 0x60FF0020)),
    transmit=((0x60410010, 0x60610008, 0x603F0010, 0x60770010), (0x60640020, 0x606C0020)),
    fixed=True,
)
"""Maps by itself, torque offset and error code among what is mapped; no 0x6007, no 0x1400:5."""

DRIVES = {"epos4-like": EPOS4_LIKE, "nanotec-like": NANOTEC_LIKE, "fixed-mapping": FIXED_MAPPING}


def eds_text(drive: Drive) -> str:
    """Return the EDS file of a drive."""
    objects: dict[int | tuple[int, int], Entry] = dict(drive.objects)
    for subindex, value in ((1, drive.vendor), (2, drive.product), (3, 1), (4, 7)):
        objects[0x1018, subindex] = Entry("u32", "ro", f"0x{value:08X}")
    for base, cob_id, pdos, more in (
        (0x1400, 0x200, drive.receive, drive.receive_subindices),
        (0x1800, 0x180, drive.transmit, drive.transmit_subindices),
    ):
        for place, mapped in enumerate(pdos):
            default = f"$NODEID + 0x{cob_id + 0x100 * place:X}" if place < 4 else CHANGED_LATER
            objects[base + place, 1] = Entry("u32", "rw", default)
            objects[base + place, 2] = Entry("u8", "rw", TYPE_255)
            objects |= {
                (base + place, subindex): Entry("u16", "rw", "10" if subindex == 3 else "0") for subindex in more
            }
            access = "ro" if drive.fixed else "rw"
            mapping = base + 0x200 + place
            objects[mapping, 0] = Entry("u8", access, str(len(mapped)))
            for entry in range(1, (len(mapped) if drive.fixed else 8) + 1):
                value = mapped[entry - 1] if entry <= len(mapped) else 0
                objects[mapping, entry] = Entry("u32", access, f"0x{value:08X}")
    head = [
        "[FileInfo]",
        f"FileName={drive.name}.eds",
        "[DeviceInfo]",
        "VendorName=written for a test",
        f"VendorNumber=0x{drive.vendor:X}",
        f"ProductName={drive.name}",
        "BaudRate_1000=1",
        "[DummyUsage]",
        "Dummy0002=1",
        "[Comments]",
        "Lines=1",
    ]
    return "\n".join([*head, *_sections(objects)]) + "\n"


def _sections(objects: dict[int | tuple[int, int], Entry]) -> list[str]:
    lines: list[str] = []
    records: dict[int, dict[int, Entry]] = {}
    for place, entry in objects.items():
        if isinstance(place, int):
            lines += [f"[{place:04X}]", f"ParameterName=Object {place:04X}", "ObjectType=0x7", *_entry(entry)]
        else:
            records.setdefault(place[0], {})[place[1]] = entry
    for index, entries in records.items():
        highest = str(max(entries))
        entries.setdefault(0, Entry("u8", "ro", highest))
        lines += [f"[{index:04X}]", f"ParameterName=Object {index:04X}", "ObjectType=0x9", f"SubNumber={len(entries)}"]
        for subindex, entry in sorted(entries.items()):
            name = f"Object {index:04X} sub {subindex}"
            lines += [f"[{index:04X}sub{subindex:X}]", f"ParameterName={name}", "ObjectType=0x7", *_entry(entry)]
    return lines


def _entry(entry: Entry) -> list[str]:
    return [
        f"DataType=0x{CODES[entry.type]:04X}",
        f"AccessType={entry.access}",
        f"DefaultValue={entry.default}",
        f"PDOMapping={int(entry.mappable)}",
    ]
