"""The passport of a gear: its runs over time as control charts, from the analyses that lie beside the runs.

`content` says what a passport holds, `build` makes one; `followed` reads what protocols declare as
watched, `chart` the individuals chart, `gather` the way from run files to points,
`draw` the figures, `analyse` fits what is not fitted yet.
"""
