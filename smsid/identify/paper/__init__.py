"""The paper's linear method: reference, and first guess of the likelihood.

`smsid.identify.paper.pipeline.identify` goes from recordings to an estimate: Exp. 1 (`exp1`) by a regression
along each axis, as printed (`translation`) and whitened with its products tied (`translation_tied`), which is
what is used; modes by SSI-COV (`smsid.identify.appendage_modes`); Exp. 2 (`exp2`) by observers of slosh and
bending (`slosh_state`, `modal_state`), Step A and Step B (`momentum`), and Step B as printed
(`momentum_printed`). Total least squares (`smsid.identify._tls`) solves all of them.
"""
