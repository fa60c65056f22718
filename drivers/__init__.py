"""What is outside: CAN, the CANopen servo drive, Modbus brake and sensors, and a virtual bench on the same wires."""
