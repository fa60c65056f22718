"""Modbus TCP and RTU on a line that never blocks the scan, and the devices on it."""
