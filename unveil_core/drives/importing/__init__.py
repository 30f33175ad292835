"""From a drive as read to the folder ``drive/`` of a workspace."""
