"""The frame that every page stands in: what the pages share (`session`), the theme and its colours."""
