"""Verbs that begin with a clip or photographs."""
