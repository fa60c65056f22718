"""A CAN bus that never blocks the scan: SocketCAN, socketcand and serial adapters."""
