"""The steps of a plan, one file per kind: its fields, what it refuses, its course on a rig, its forecast, its words.

Speeds are input speeds in rad/s, signed; angles are input angles in rad. A plan is a pure function:
no clock, no random, no feedback. Feedback lives in steps that end on a condition and carry
`at_most`, so that nominal and longest duration of a plan are known before anything moves. A step
with a `segment` is recorded as one; analysis never guesses it back.

Plans are written in the words of `experiments.steps.vocabulary`. Whatever executes, forecasts or
draws a plan asks the step itself (`experiments.steps.kind`), so that a new kind is its own file and
its place in the vocabulary.
"""
