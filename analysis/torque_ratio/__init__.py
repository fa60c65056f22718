"""The torque ratio: calibration runs or measured pairs in; lines of four quadrants and converted torque out."""
