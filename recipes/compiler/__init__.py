"""From a recipe and a bench to the program that the controller goes by: every time in scans, every torque in N·m."""
