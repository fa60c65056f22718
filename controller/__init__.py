"""What is decided, once per scan: process image, states, faults, interlocks, set-points. Pure, without clock or I/O.

Side by side, because all take part in one step of the controller: states by group, interlocks (debounce, conditions,
limits), ramps. From outside `controller` runs them all.
"""
