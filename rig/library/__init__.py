"""The runs of a folder: their numbers, what each says of itself, and an index that makes a large
folder quick to search.

The files are the truth. `folder` gives out numbers and lists the files as they are; `index`
keeps what they said in a cache beside them, which may be deleted at any time.
"""
