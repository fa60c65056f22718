"""What answers on the wires: servo drive by CANopen, amplifier, brake and remote I/O by Modbus, and their gateways."""
