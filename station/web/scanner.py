"""What a scanner sends, as a serial number: plain text, or GS1 element strings with the serial number in AI 21.

A GS1 code says what it is by the symbology identifier in front of it (ISO/IEC 15424), or by brackets about its
application identifiers. An element of variable length ends with the separator GS (GS1 General Specifications, 7.8). The
identifier of any other symbology only says how the code was printed, and is no part of the serial number.
"""

from __future__ import annotations

import re

from station.errors import StationError
from station.records.certificate_code import names_a_run
from station.records.data_folder import LONGEST_SERIAL, is_serial

GS = "\x1d"
SYMBOLOGIES = ("]C1", "]e0", "]d2", "]Q3", "]J1")
"""GS1-128, GS1 DataBar, GS1 DataMatrix, GS1 QR Code, GS1 DotCode."""

IDENTIFIER = re.compile(r"\][A-Za-z][0-9A-Za-z]")
"""What a scanner may be set to send in front of every code: the identifier of its symbology."""

FIXED = {"00": 18, "01": 14, "02": 14, "11": 6, "12": 6, "13": 6, "15": 6, "16": 6, "17": 6, "20": 2}
"""Digits of the elements of fixed length, by application identifier: no separator stands behind them."""

VARIABLE = {"10": 20, "21": 20, "22": 20, "240": 30, "241": 30, "250": 30, "251": 30}
"""Most characters of the others that stand on units."""

SERIAL = "21"

NOK = "NOK"
"""What is scanned from the box for bad units once a bad unit is in it, in capitals or not."""

AROUND = "\r\n\t \x00"
"""What may stand around a code and is no part of it."""

TWO_CODES = "has the code of more than one unit: the scanner sent two codes as one. Scan the unit again"

BRACKETS = re.compile(r"\((\d{2,4})\)([^()]*)")


class ScanError(StationError):
    """What was scanned is no serial number."""


def serial_of(scanned: str) -> str:
    """Return the serial number in what was scanned; carriage return, line feed, tabs and blanks around it do not count.

    Raises:
        ScanError: it is empty, too long, has characters that no scanner sends, is a GS1 code without serial number or
            with several, has a second code behind the first, or is the code of a label or a certificate.

    """
    text = scanned.strip(AROUND)
    if (found := IDENTIFIER.match(text)) is not None:
        text = text[found.end() :]
        if found[0] in SYMBOLOGIES:
            return _of_elements(text)
        text = text.strip(AROUND)
        if found[0] in text:
            raise ScanError(f"{text[:60]!r}: {TWO_CODES}")
    if BRACKETS.match(text):
        elements = BRACKETS.findall(text)
        serials = [value for name, value in elements if name == SERIAL]
        if len(serials) > 1:
            raise ScanError(f"{text[:60]!r}: {TWO_CODES}")
        if "".join(f"({name}){value}" for name, value in elements) != text or not any(serials):
            raise ScanError(f"{text[:60]!r}: is a GS1 text without a serial number (21). Scan the code of the unit")
        return _checked(serials[0])
    return _checked(text)


def is_nok(scanned: str) -> bool:
    """Say whether what was scanned is the code on the box for bad units."""
    return without_identifier(scanned).strip().upper() == NOK


def without_identifier(scanned: str) -> str:
    """Return the text of a code that is no unit's, as of a label: without what only says how it was printed."""
    text = scanned.strip()
    found = IDENTIFIER.match(text)
    return text if found is None else text[found.end() :]


def _of_elements(text: str) -> str:
    serial = None
    while text:
        name = next((one for one in (*FIXED, *VARIABLE) if text.startswith(one)), None)
        if name is None:
            raise ScanError(
                f"{text[:20]!r}: is not a GS1 element for a unit; a separator may be lost. Check the scanner's "
                "setting for GS (FNC1), and scan again"
            )
        text = text[len(name) :]
        if name in FIXED:
            value, text = text[: FIXED[name]], text[FIXED[name] :].removeprefix(GS)
            whole = len(value) == FIXED[name] and value.isdecimal() and value.isascii()
        else:
            value, _, text = text.partition(GS)
            whole = 0 < len(value) <= VARIABLE[name]
        if not whole:
            raise ScanError(
                f"({name}){value[:40]!r}: is not the whole element; a separator may be lost. Check the scanner's "
                "setting for GS (FNC1), and scan again"
            )
        if name == SERIAL and serial is not None:
            raise ScanError(f"({name}){value[:40]!r}: {TWO_CODES}")
        serial = value if name == SERIAL else serial
    if serial is None:
        raise ScanError("this GS1 code has no serial number (21). Scan the code of the unit")
    return _checked(serial)


def _checked(text: str) -> str:
    if names_a_run(text):
        raise ScanError("this is the code of a label or a certificate. Scan the code of the unit")
    if not is_serial(text) or not text.isascii():
        raise ScanError(
            f"{text[:40]!r}: is not a serial number; allowed are 1 to {LONGEST_SERIAL} printable ASCII characters, "
            "with no blank at the ends. Scan again, or check the scanner's keyboard layout"
        )
    return text
