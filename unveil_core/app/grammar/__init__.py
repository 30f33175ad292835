"""How the command reads and explains itself: parsers with short help, options of the table of settings, examples, completion."""
