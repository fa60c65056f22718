"""An slcan adapter on a serial port of the virtual bench: the other side of python-can's slcan interface.

The protocol is one line per command or frame, ended by a carriage return: `S0` to `S8` bit rate, `O` open, `L` listen
only, `C` close, `V` version, `N` serial number, `F` status, `tIIILDD..` a frame to send (T: 29-bit identifier; r, R:
remote frames). A command is answered by a carriage return, a frame that was taken by `z` (or `Z`) and a carriage
return, anything else by a bell. Frames of the bus come as the same `t` lines, while the channel is open.
"""

from __future__ import annotations

from collections.abc import Callable

from virtual_bench.wires.pty_port import PtyPort

DONE, REFUSED = b"\r", b"\a"
BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
"""Bit rates of `S0` to `S8` [bit/s]."""

FRAME_LETTERS = b"tTrR"
ANSWERS = {b"": DONE, b"V": b"V1013" + DONE, b"N": b"NLM01" + DONE, b"F": b"F00" + DONE}
"""To an empty line, and to what is asked of the adapter itself: version, serial number, status flags."""

LONGEST_LINE = 27
"""Bytes of a 29-bit frame with 8 data bytes."""

HEX_DIGITS = {ord("t"): (3, 0x7FF), ord("T"): (8, 0x1FFF_FFFF), ord("r"): (3, 0x7FF), ord("R"): (8, 0x1FFF_FFFF)}
"""Digits and largest value of the identifier, by the first letter of a frame."""

Listener = Callable[[int, bytes], None]


class SlcanServer:
    """One adapter. `on_frame` gets what the controller sends; `send` is the local node's way out.

    `bitrate` is that of the bus: a channel that was opened with another one hears and reaches nobody.
    """

    def __init__(self, link: str, bitrate: int, on_frame: Listener, log: Callable[[str, str], None]) -> None:
        self._port = PtyPort(self._take, link)
        self._bitrate = bitrate
        self._on_frame = on_frame
        self._log = log
        self._buffer = b""
        self._chosen_bitrate = 0
        self._open = False
        self._listen_only = False
        self._losing = False
        self.frames_sent = 0

    async def start(self) -> str:
        """Make the serial port and return its path; raises `OSError` when it cannot be had."""
        return self._port.open()

    async def stop(self) -> None:
        """Pull the adapter out."""
        self.cut()

    def cut(self) -> None:
        """Pull the adapter out, in the middle of it."""
        self._port.close()

    def send(self, cob_id: int, data: bytes) -> None:
        """Put a frame of the local node on the bus."""
        if not self._hears:
            return
        self.frames_sent += 1
        lost = not self._port.write(b"t%03X%d%s\r" % (cob_id, len(data), data.hex().upper().encode()))
        if lost and not self._losing:
            self._log("can_overrun", f"the controller does not read {self._port.path}: frames are lost")
        self._losing = lost

    @property
    def connected(self) -> bool:
        """Whether frames of the controller can come."""
        return self._hears

    def flush(self) -> None:
        """Do nothing: frames are written at once."""

    @property
    def _hears(self) -> bool:
        return self._open and self._chosen_bitrate == self._bitrate

    def _take(self, data: bytes) -> None:
        *lines, self._buffer = (self._buffer + data).split(DONE)
        for line in lines:
            self._port.write(self._obey(line))
        if len(self._buffer) > LONGEST_LINE:
            self._buffer = b""
            self._port.write(REFUSED)

    def _obey(self, line: bytes) -> bytes:
        """Do what a line says and return the answer."""
        letter, rest = line[:1], line[1:]
        answer = REFUSED
        if letter and letter in FRAME_LETTERS:
            answer = self._frame(line) if self._open and not self._listen_only else REFUSED
        elif letter in ANSWERS:
            answer = ANSWERS[letter]
        elif letter == b"S" and not self._open and rest.isdigit() and int(rest) < len(BITRATES):
            self._chosen_bitrate = BITRATES[int(rest)]
            answer = DONE
        elif letter in (b"O", b"L") and not self._open and self._chosen_bitrate:
            self._open, self._listen_only = True, letter == b"L"
            self._tell_opened()
            answer = DONE
        elif letter == b"C" and self._open:
            self._open = False
            self._log("can_client_gone", f"channel of {self._port.path} closed")
            answer = DONE
        return answer

    def _tell_opened(self) -> None:
        rate = f"{self._chosen_bitrate} bit/s"
        if self._chosen_bitrate == self._bitrate:
            self._log("can_client", f"channel of {self._port.path} opened at {rate}")
        else:
            self._log("can_bitrate", f"channel of {self._port.path} opened at {rate}, the bus has {self._bitrate}")

    def _frame(self, line: bytes) -> bytes:
        digits, largest = HEX_DIGITS[line[0]]
        remote, extended = line[0] in b"rR", line[0] in b"TR"
        try:
            cob_id = int(line[1 : 1 + digits], 16)
            size = int(line[1 + digits : 2 + digits])
            data = bytes.fromhex(line[2 + digits :].decode("ascii"))
        except ValueError:
            return REFUSED
        if cob_id > largest or size > 8 or len(data) != (0 if remote else size):
            return REFUSED
        if self._hears and not remote and not extended:
            self._on_frame(cob_id, data)
        return (b"Z" if extended else b"z") + DONE
