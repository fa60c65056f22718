"""Service data objects before the scan: canopen's SDO client without its thread, and hints for refused transfers.

canopen waits for a reply that another thread brings; here the client itself takes the frames from the bus while it
waits. Reads and writes are raw, with the type given, so no vendor's EDS file is needed. Blocking: never in the scan.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import can
import canopen
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from definitions.number_formats import SIZES
from drivers.can.bus import CanLink
from drivers.servo_drive.pdo import EMCY_BASE, HEARTBEAT_BASE, SDO_ANSWER_BASE, SDO_REQUEST_BASE

_T = TypeVar("_T")

NMT_START = 0x01
NMT_ENTER_PRE_OPERATIONAL = 0x80
NMT_RESET_COMMUNICATION = 0x82

OBJECT_MISSING = 0x0602_0000
SUBINDEX_MISSING = 0x0609_0011


class AbortHint(NamedTuple):
    """Cause and next action of an SDO abort code."""

    cause: str
    next_action: str


SDO_ABORTS = MappingProxyType(
    {
        0x0503_0000: AbortHint("toggle bit error", "check the CAN cable and termination, then try again"),
        0x0504_0000: AbortHint("transfer timed out", "check bus load and cable, then try again"),
        0x0504_0001: AbortHint("unknown transfer command", "check that the node is the device of the profile"),
        0x0504_0002: AbortHint("wrong block size", "check that the node is the device of the profile"),
        0x0504_0003: AbortHint("wrong sequence of a block transfer", "check the CAN cable and termination, try again"),
        0x0504_0004: AbortHint("check sum of a block transfer wrong", "check the CAN cable and termination, try again"),
        0x0504_0005: AbortHint("the device is out of memory", "switch the device off and on"),
        0x0601_0000: AbortHint("access not supported", "compare the object with the device's manual"),
        0x0601_0001: AbortHint("the object can only be written", "it cannot be verified: ask the vendor"),
        0x0601_0002: AbortHint("the object can only be read", "set it with the vendor's tool to the value expected"),
        0x0602_0000: AbortHint("the object does not exist", "this device lacks it: compare profile, firmware, manual"),
        0x0604_0041: AbortHint("the object cannot be mapped", "correct the mapping in the profile"),
        0x0604_0042: AbortHint("the mapping is too long", "correct the mapping in the profile"),
        0x0604_0043: AbortHint("parameters do not fit together", "check the limits in the bench file"),
        0x0604_0047: AbortHint("the device's parameters conflict", "load the device's parameter set again"),
        0x0606_0000: AbortHint("hardware error in the device", "switch the device off and on; read its error history"),
        0x0607_0010: AbortHint("wrong data type or length", "correct the type of this object in the profile"),
        0x0607_0012: AbortHint("data too long", "correct the type of this object in the profile"),
        0x0607_0013: AbortHint("data too short", "correct the type of this object in the profile"),
        0x0609_0011: AbortHint("the subindex does not exist", "this device lacks it: compare profile and manual"),
        0x0609_0030: AbortHint("value outside the device's range", "correct the value in the bench file"),
        0x0609_0031: AbortHint("value too high for this device", "lower the value in the bench file"),
        0x0609_0032: AbortHint("value too low for this device", "raise the value in the bench file"),
        0x0609_0036: AbortHint("maximum below minimum", "check the device's limits with the vendor's tool"),
        0x060A_0023: AbortHint("resource not available", "switch the device off and on"),
        0x0800_0000: AbortHint("general error", "read the device's error history 0x1003"),
        0x0800_0020: AbortHint("the device cannot store the value", "check that no password locks it"),
        0x0800_0021: AbortHint("the device is under local control", "set it to fieldbus control, close its tool"),
        0x0800_0022: AbortHint(
            "not in this state", "the device must be disabled: check that no other master enables it"
        ),
        0x0800_0023: AbortHint("no object dictionary", "switch the device off and on; check its firmware"),
        0x0800_0024: AbortHint("no data", "switch the device off and on"),
    }
)
"""SDO abort codes of CiA 301: cause and what to do next."""

_SDO_BYTES = 8
_OBJECT = slice(1, 4)
"""Bytes of a frame that hold index and subindex."""
_INITIATING = frozenset({1, 2})
"""Command specifiers of requests that name an object: download, upload."""
_NAMING_OBJECT = frozenset({2, 3, 4})
"""Command specifiers of answers that repeat the object asked for: upload, download, abort."""
_ANSWER_TO = {1: 3, 2: 2}
"""Command specifier of the answer to a request that names an object: download, upload (CiA 301, 7.2.4.3)."""
_ABORT = 4
_NO_OBJECT = bytes(3)
"""What some nodes put into an abort in place of the object."""

_UNKNOWN_ABORT = AbortHint("abort code without a standard meaning", "look the code up in the drive's manual")


class SdoFailure(Exception):  # noqa: N818 - it is told to the caller of set-up as a Problem, never raised to a person
    """A transfer that did not happen; `abort_code` is 0 when the node did not answer."""

    def __init__(self, cause: str, next_action: str, abort_code: int = 0) -> None:
        super().__init__(cause)
        self.cause = cause
        self.next_action = next_action
        self.abort_code = abort_code


def explain_abort(code: int) -> AbortHint:
    """Cause and next action of an SDO abort code."""
    return SDO_ABORTS.get(code, _UNKNOWN_ABORT)


class _PumpedSdoClient(SdoClient):
    """canopen's SDO client that takes its replies from the bus itself.

    A request is sent again when its answer is late, so an answer may come twice: answers to another object than the
    one that was asked for last, or to reading where it is written, are left-overs and are dropped.
    """

    RESPONSE_TIMEOUT = 0.001  # what is left for canopen's queue once `read_response` has waited

    def __init__(self, node_id: int, pump: Callable[[float], None], reply_timeout_s: float, tries: int) -> None:
        super().__init__(SDO_REQUEST_BASE + node_id, SDO_ANSWER_BASE + node_id, ObjectDictionary())  # type: ignore[no-untyped-call]
        self.MAX_RETRIES = tries  # canopen counts the first request as well
        self._pump = pump
        self._reply_timeout_s = reply_timeout_s
        self._asked_for = b""
        self._answers: frozenset[int] = frozenset()

    def send_request(self, request: bytes | bytearray) -> None:
        if request[0] >> 5 in _INITIATING:
            self._asked_for = bytes(request[_OBJECT])
            self._answers = frozenset({_ANSWER_TO[request[0] >> 5], _ABORT})
        super().send_request(request)  # type: ignore[no-untyped-call]

    def on_response(self, can_id: int, data: bytes | bytearray, timestamp: float) -> None:
        if len(data) != _SDO_BYTES:
            return
        specifier = data[0] >> 5
        answers = specifier in self._answers and data[_OBJECT] in (self._asked_for, _NO_OBJECT)
        if answers or specifier not in _NAMING_OBJECT:
            super().on_response(can_id, data, timestamp)  # type: ignore[no-untyped-call]

    def read_response(self) -> bytes:
        deadline = time.monotonic() + self._reply_timeout_s
        while self.responses.empty() and (left := deadline - time.monotonic()) > 0:
            self._pump(left)
        response: bytes = super().read_response()  # type: ignore[no-untyped-call]
        return response


class SdoNode:
    """A node addressed before the scan: SDO transfers, NMT commands, and the NMT states it was heard in."""

    def __init__(self, link: CanLink, node_id: int, reply_timeout_s: float = 1.0, tries: int = 2) -> None:
        """Listen to node `node_id` (1 to 127) on an open bus; a request takes at most `tries` reply time-outs."""
        logging.getLogger("canopen").setLevel(logging.CRITICAL)  # its errors come back to the caller as well
        self.node_id = node_id
        self.heard: list[int] = []
        self._link = link
        self._network = canopen.Network(link.bus)
        self._client = _PumpedSdoClient(node_id, self.pump, reply_timeout_s, tries)
        self._client.network = self._network
        self._network.subscribe(SDO_ANSWER_BASE + node_id, self._client.on_response)
        self._network.subscribe(HEARTBEAT_BASE + node_id, self._hear)

    def _hear(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if data:
            self.heard.append(data[0] & 0x7F)

    def pump(self, timeout_s: float) -> None:
        """Wait for one frame, at most `timeout_s`, and hand it to whom it concerns; emergencies wait for the scan."""
        message = self._link.bus.recv(timeout_s)
        if message is not None and not message.is_error_frame and not message.is_remote_frame:
            self._link.keep_emergency(message)
            self._network.notify(message.arbitration_id, message.data, message.timestamp)

    def command(self, nmt_command: int) -> None:
        """Send an NMT command to this node and forget what was heard from it before."""
        self.heard.clear()
        try:
            self._network.send_message(0, bytes((nmt_command, self.node_id)))
        except (can.CanError, OSError) as error:
            raise _bus_failure(error) from error

    def forget_emergencies(self) -> None:
        """Forget the emergency messages that this node has sent until now."""
        self._link.early.pop(EMCY_BASE + self.node_id, None)

    def wait_for(self, nmt_state: int, timeout_s: float) -> bool:
        """Wait until the node is heard in an NMT state; False after the time-out."""
        deadline = time.monotonic() + timeout_s
        try:
            while nmt_state not in self.heard:
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self.pump(left)
        except (can.CanError, OSError, ValueError) as error:
            raise _bus_failure(error) from error
        return True

    def read(self, index: int, subindex: int, type_name: str) -> int:
        """Read an object; raises SdoFailure."""
        data = self._transfer(lambda: self._client.upload(index, subindex))
        size = SIZES[type_name]
        if len(data) < size:
            raise SdoFailure(
                f"the device sent {len(data)} bytes instead of {size}", "correct the type of this object in the profile"
            )
        return int.from_bytes(data[:size], "little", signed=type_name.startswith("i"))

    def write(self, index: int, subindex: int, type_name: str, value: int) -> None:
        """Write an object; raises SdoFailure."""
        data = value.to_bytes(SIZES[type_name], "little", signed=type_name.startswith("i"))
        self._transfer(lambda: self._client.download(index, subindex, data))

    def _transfer(self, transfer: Callable[[], _T]) -> _T:
        try:
            return transfer()
        except SdoAbortedError as error:
            hint = explain_abort(error.code)
            raise SdoFailure(
                f"the device refused: abort 0x{error.code:08X}, {hint.cause}", hint.next_action, error.code
            ) from error
        except SdoCommunicationError as error:
            raise SdoFailure("no answer", "check power, node id, bit rate, cable and termination") from error
        except (can.CanError, OSError, ValueError) as error:
            raise _bus_failure(error) from error


def _bus_failure(error: Exception) -> SdoFailure:
    return SdoFailure(f"the bus failed: {error}", "check that the CAN interface is up and its cable connected")
