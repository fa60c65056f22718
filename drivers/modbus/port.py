"""The ports under a Modbus line: a TCP connection or a serial port, opened with time-outs, used without waiting."""

from __future__ import annotations

import socket

import serial

from drivers.config import ModbusConfig


def open_port(config: ModbusConfig) -> socket.socket | serial.Serial:
    """Open the device's port (blocking, bounded by the connect time-out), non-blocking from then on.

    Raises OSError, or ValueError for serial parameters that the port does not take.
    """
    return _open_serial(config) if config.transport == "rtu" else _open_socket(config)


def _open_socket(config: ModbusConfig) -> socket.socket:
    client = socket.create_connection((config.host, config.port), timeout=config.connect_timeout_s)
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client.setblocking(False)  # noqa: FBT003
    return client


def _open_serial(config: ModbusConfig) -> serial.Serial:
    # pyserial opens the port with O_NONBLOCK; the line then reads and writes its descriptor directly
    port = serial.Serial(
        config.serial_port,
        config.baudrate,
        parity=config.parity,
        stopbits=config.stop_bits,
        timeout=0,
        write_timeout=0,
        exclusive=True,
    )
    port.reset_input_buffer()
    return port
