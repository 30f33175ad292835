"""How files are opened and made: what lies in drives and workspaces may come from a stranger."""
