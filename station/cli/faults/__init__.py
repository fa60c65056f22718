"""Commands of the fault lab. Nothing else names the fault lab, and it is loaded when one of them is asked for."""
