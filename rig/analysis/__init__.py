"""From recordings to results: `fit` analyses, `store` keeps, `difference` compares two runs, `passport` follows a gear.

Knows run files and the library, never a rig that turns and never a page that shows. Start in `fit`.
"""
