"""A bench made of software that speaks the wires of a real one: physics, drive, faults, devices."""
