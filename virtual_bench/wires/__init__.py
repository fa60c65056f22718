"""What the devices hang on: CAN by socketcand, python-can or a serial adapter, and pairs of serial ports."""
