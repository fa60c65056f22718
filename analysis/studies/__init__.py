"""Studies beside the loop: runs or rows of a table in; eccentricity, frequency response, lock angle, temperature out.

A simulated unit on a simulated bench stands here too, of which the truth is known: it says whether the stated
uncertainty holds.
"""
