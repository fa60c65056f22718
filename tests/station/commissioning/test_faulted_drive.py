"""A drive that is in fault before anybody listens: its emergency message is gone, its error code is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from table_drive_bus import on_the_bus

from station.commissioning.probe import drive_fault

CODES = {0x7121: "motor blocked", 0: "no cause given"}


@pytest.mark.parametrize("code", CODES)
def test_a_drive_in_fault_is_told_with_what_its_error_code_means(tmp_path: Path, code: int) -> None:
    def held(*, index: int, **_: Any) -> int | None:
        return {0x6041: 0x0218, 0x603F: code}.get(index)

    with on_the_bus(tmp_path, "nanotec-like") as (slave, link, config):
        assert drive_fault(link, config) == []
        slave.node.add_read_callback(held)
        (found,) = drive_fault(link, config)
    assert not found.refuses
    assert f"0x{code:04X} (0x603F): {CODES[code]}." in found.what
    assert "Then switch the drive off and on" in found.cure
