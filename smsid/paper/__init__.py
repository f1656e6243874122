"""Tables that only reproduce the paper.

`tables`: Tables 2 and 3 beside an estimate. Table 4 is flown by ``benchmarks/table4.py``.
"""
