"""What is decided, once per scan: process image, states, faults, interlocks, set-points. Pure, without clock or I/O."""
