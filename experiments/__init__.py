"""The test protocols: what each declares, its plan, its analysis.

A plan is a pure function that yields steps (`experiments.steps`); an analysis turns a `Recording` (SI arrays, segments,
metadata) into a `Result`. This floor may import `model`, and never sees hardware, files or windows. Start reading in
`experiments.contract`, then in any protocol, for instance `experiments.protocols.friction.declaration`.
"""
