"""Commands on a bench: virtual bench, timing, blank test, torque ratio and stored calibrations."""
