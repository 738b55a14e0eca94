"""The protocols: each a folder of what it declares (`declaration`), what its run does (`plan`) and its `analysis`.

A declaration names the functions of the other two by their place and imports neither: it is read by whoever lists,
judges or describes. Start reading in `friction.declaration`; `home` is the shortest one.
"""
