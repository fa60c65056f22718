"""`lostmotion bench ...`: the steps of commissioning, on the command line."""
