"""Orders of a channel over an angle: one estimator, whatever the length, the motion and the sampling.

    y(theta) = z_s(theta) + sum_v (a_v± cos v theta + b_v± sin v theta)

Trend, all orders and both directions are estimated together, at the angles where the samples are;
nothing is put onto a grid of angle first and nothing is subtracted. Start reading in `fit`:
`fit_samples` finds the orders (`search`, on the spectra of `comb`), solves them (`regression`), takes
the noise of each from what is left beside it, and `aliases` says which of them the samples cannot
tell apart. `samples` holds the data, `turning` says where an angle turns one way.
"""
