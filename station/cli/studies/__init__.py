"""Studies of lock angle, temperature and frequency, and models of a loop."""
