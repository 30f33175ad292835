"""A scene as a frame sees it: how deep its surfaces are."""
