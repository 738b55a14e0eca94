"""What is said, in words, before anything paints it: one content for terminal, window, web page and paper.

Who knows something says it here, once; who shows it paints what is here, and words nothing again.

- A *producer* stands beside what it knows and gives facts and grids: `rig.runfile` the facts of a run,
  `rig.analysis` the rows of a result, a difference, a passport. Every cell is text, already in the unit of a
  laboratory and rounded by its uncertainty (`wording`); a painter that computes takes the numbers from the result.
- A *painter* takes them as they are: `rig.present` (HTML, typst), `rig.window`, `rig.commands.terminal`. It
  chooses letters, colours and widths by the kind of a column and the tone of a word, never by a heading.

`grid` has `Grid` with its `Column`s, `Fact`, and the tone of a word; `wording` numbers and estimates as text;
`phrase` what is said only where there is something to say; `data` makes a grid of a table of numbers; `page` has a
whole report: sections, figures, annexes. Headings and titles of facts begin small: a painter of pages begins them with
a capital (`capital`), a symbol stays what it is.
This room draws nothing, reads no file, and stands below `rig.runfile`, so that every producer may import it.

    grid = Grid("Results", columns("quantity", ("value", "number"), ("identifiable", "word")), rows, "a remark")
    grid.without("remark")                         # a painter with less room
    console().print(terminal.painted(grid))        # on a terminal
    GridTable(session, "Results").show_grid(grid)  # in the window
    words.grid_html(grid, palette)                 # in a page of rich text of the window
"""
