"""A jog: a technician turns the shaft slowly by hand control, in a process of its own, recorded as a run is."""
