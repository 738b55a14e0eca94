"""The page of a run that goes on: banner, question, live curves, margins, outcome. Start in `page`."""
