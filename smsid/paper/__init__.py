"""Tables and studies that only reproduce the paper.

A leaf: it flies `smsid.control`, fills tables of `smsid.report`, and only commands, pages and benchmarks that
show the paper's figures import it.

- `tables`: Tables 2 and 3 beside an estimate.
- `table4`: the cases of Table 4, flown; `table4_study` is ``smsid control --study table4``, with its summary
  and its page.
"""
