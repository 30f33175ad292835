"""Networks of strangers, each in a process of its own."""
