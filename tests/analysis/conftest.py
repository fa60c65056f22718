"""The tests of the analysis stand in rooms as it does; what several rooms use stands here, beside this file."""
