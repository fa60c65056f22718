"""There is no pandas where lostmotion is installed, and none for the processes of its tests.

pyarrow loads it with its first array wherever it is installed: half a second of processor time for each process that
reads a record. Only the other reader of AQDEF files needs it, and goes around this (`station/store/test_dfq.py`).
"""

raise ImportError("the tests hide pandas: an installation has none")
