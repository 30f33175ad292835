"""The ``unveil`` command: parser, verbs, doctor. Nothing here computes."""
