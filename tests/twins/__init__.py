"""Independent oracles: the same spacecraft derived and simulated by code that shares nothing with smsid.

Nothing in this package imports `smsid` or Pinocchio; `test_twins.py` checks that.
"""
