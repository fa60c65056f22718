"""A drive of the second CANopen stack on a bus of this process, with the profile drafted from its own EDS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers_support import drive_config, drive_profile
from eds_drives import DRIVES, eds_text
from ruamel.yaml import YAML
from table_drive import Personality, TableDrive

from drivers.can.bus import CanLink, open_can
from drivers.config import CanConfig, DriveConfig
from station.bench.eds_profile import draft

CHANNEL = "second-slave"


@contextmanager
def on_the_bus(
    folder: Path, name: str, personality: Personality | None = None, **changes: object
) -> Iterator[tuple[TableDrive, CanLink, DriveConfig]]:
    """Open a drive made of its EDS, a link to it, and the configuration by the profile drafted from that EDS."""
    path = folder / f"{name}.eds"
    path.write_text(eds_text(DRIVES[name]), encoding="utf-8")
    raw = YAML(typ="rt").load(draft(path).text)
    raw["scaling"].setdefault("position_counts_per_motor_rev", 4096.0)
    raw["scaling"].setdefault("velocity_counts_per_rad_s", 651.9)
    raw |= changes
    slave, link = TableDrive(CHANNEL, DRIVES[name], personality), open_can(CanConfig("virtual", CHANNEL))
    try:
        yield slave, link, drive_config(profile=drive_profile(raw))
    finally:
        link.close()
        slave.close()
