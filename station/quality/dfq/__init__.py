"""Values of runs as an AQDEF file (`.dfq`), which statistics programs of the automotive industry read."""
