"""A CiA 402 servo drive over CANopen: set up and read back before the scan, driven by process data within it."""
