"""AQDEF files for the statistics program of a plant, written to its folder as runs are sealed."""
