"""Test code of the scanner: once a shift a scan shows that keyboard layout and Caps Lock leave a code as it is printed.

A scanner that works as a keyboard sends keys, and the computer makes characters of them by its own layout. With another
layout than the scanner's, `y` comes as `z` and `-` as `ß`, and a serial number may become that of another unit. The
card at the bench holds the characters that tell layouts apart. It is a code of its own, and never a unit.
"""

from __future__ import annotations

from sqlalchemy import Connection, insert, select

from station.wall_clock import WALL_CLOCK
from station.web.people.database import SCANNER_TESTS
from station.web.scanner import AROUND, without_identifier
from station.web.settings import ScannerTest

US = "yzYZ-=[]\\;'/`@#^&*()_+{}|:\"<>?~"
GERMAN = "zyZYß´ü+#öä-^\"§&/()=?`Ü*'ÖÄ;:_°"
"""What the German layout (DIN 2137) makes of the keys that a scanner of the US layout presses, in this order."""

AS_GERMAN = str.maketrans(US, GERMAN)
DEAD = str.maketrans("", "", "´`^\ufffd")
"""Keys that give a character only together with the next one: pages get a mark, or nothing, in their place."""

LAYOUT = (
    "The computer reads the scanner with another keyboard layout: y and z are exchanged, - comes as ß. Set both to the "
    "same layout, then scan the test code again."
)
CAPS_LOCK = "Caps Lock is on. Switch it off, then scan the test code again."
OTHER = "This is not what the test code says. Check the scanner's settings and the computer's keyboard layout."


def misread(code: str, scanned: str) -> str | None:
    """Return what is wrong with the test code as it was read, None where it came as it was printed."""
    text = scanned.strip(AROUND)
    if code in (text, without_identifier(text)):
        return None
    found = text.translate(DEAD)
    if found in (_seen(code.swapcase()), _seen(code.swapcase().translate(AS_GERMAN))):
        return CAPS_LOCK
    return LAYOUT if found == _seen(code.translate(AS_GERMAN)) else OTHER


def is_test_code(code: str, scanned: str) -> bool:
    """Say whether a scan is the test code, also where it was misread in a way that is known."""
    why = misread(code, scanned)
    return why is None or why is not OTHER


def _seen(text: str) -> str:
    return text.translate(DEAD)


def keep_test(connection: Connection, name: str) -> None:
    """Keep that the scanner was tested now."""
    connection.execute(insert(SCANNER_TESTS).values(name=name, at_s=WALL_CLOCK.now().timestamp()))


def is_tested(connection: Connection, test: ScannerTest | None) -> bool:
    """Say whether the scanner was tested not too long ago; where the site has no test code it need not be."""
    if test is None:
        return True
    now_s = WALL_CLOCK.now().timestamp()
    newest = connection.execute(select(SCANNER_TESTS.c.at_s).order_by(SCANNER_TESTS.c.number.desc()).limit(1)).scalar()
    # A test in the future is of a clock that was set back: it says nothing of this shift.
    return newest is not None and now_s - 3600.0 * test.hours <= newest <= now_s
