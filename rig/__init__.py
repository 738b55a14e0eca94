"""The application: what turns a rig, records it, judges what was recorded, and shows it.

Eight layers, checked by import-linter; each may import what stands below it:

    main                            the table of commands
    commands · window               what a person types, and what a person sees
    trial                           doctor, drill, demo: what makes a rig turn for a purpose of its own
    run · present                   one execution of a protocol; one look for terminal, window, page and paper
    analysis                        fits, their store, what differs between runs, the passport of a gear
    gears · library · bench         gear cards; the index of runs; the physical rig: identity, limits, backends
    runfile                         the run file: layout, writing, reading, sealing, importing
    errors · exits                  what can go wrong, and what an ending means to whoever called

Start reading in `rig.main` (the commands) and `rig.run.session` (the one loop in which a rig turns).
"""
