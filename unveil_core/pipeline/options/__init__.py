"""How a setting of a run is described, given and kept: one table, from which the command, the add-on, the API and the pages follow.

No stage imports it, so that another word of help makes no finished stage stale."""
